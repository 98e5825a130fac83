"""What is true of a state, in words: built from the numbers of its view, so that line and numbers never disagree."""

import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final

NAMES: Final[Mapping[str, str]] = MappingProxyType(
    {"g1": "the first-order model", "g2": "the second-order model without delay", "g2d": "the second-order model with delay"}
)

Record = Mapping[str, Any]


def view_words(point: Record, margins: Record, promises: Record, loop: Record) -> Mapping[str, Any]:
    """Say what is true here: one line, and further ones.

    Args:
        point: the operating point's part of the view, or its problem.
        margins: those of the exact loop.
        promises: those of the models.
        loop: the engine's answer in time.
    """
    if "problem" in point:
        return {"verdict": f"no operating point: {point['problem']['detail']}", "lines": []}
    models = [] if "problem" in margins else _model_lines(promises)
    lines = [*_point_lines(point), *models, *_engine_lines(margins, loop)]
    return {"verdict": verdict(point, margins, promises, loop), "lines": lines}


def verdict(point: Record, margins: Record, promises: Record, loop: Record) -> str:
    """Say in one line how the loop is: by its exact linear model, on the engine, and what the models without delay would have said."""
    kink = ["the engine has a kink here, and a linear model holds on one side of it alone"]
    if not any(" has a kink in " in remark for remark in point.get("warnings", ())):
        kink = []
    if "problem" in margins:
        return "; ".join([f"nothing can be said of the loop: {margins['problem']['detail']}", *kink])
    if margins.get("no_control"):
        return "; ".join(filter(None, (_alone(margins), _unfinished(loop), *kink)))
    parts = [f"with the controller {_stability(margins)}" if loop.get("open_loop") else _stability(margins)]
    seen = _seen(loop, stable=bool(margins["stable"]))
    if seen:
        parts.append(seen)
    fooled = _fooled(margins, promises)
    if fooled:
        parts.append(fooled)
    if not point["stable"]:
        parts.append("the engine alone is unstable here")
    return "; ".join([*parts, *kink])


def _alone(margins: Record) -> str:
    """What it means that nothing controls the speed."""
    if not margins["stable"]:
        return "no control: kp, ki and kd are 0, and the engine alone is unstable here: its speed does not stay"
    moved = abs(margins["load_gain_rad_s_per_n_m"])
    return (
        "no control: kp, ki and kd are 0, so that the engine runs alone, stable by itself; it follows no command, and each N m of load "
        f"moves its speed by {moved:.2g} rad/s for good"
    )


def _stability(margins: Record) -> str:
    if not margins["stable"]:
        return _instability(*margins.get("stable_factors", (math.inf, 0.0)))
    rise = margins.get("gain_margin_db")
    if rise is None:
        return f"stable, Ms {margins['ms']:.2f}"
    return f"stable, gain margin {rise:.1f} dB, Ms {margins['ms']:.2f}"


def _instability(low: float, high: float) -> str:
    """By how much the gains are wrong, where one factor mends them."""
    if high < 1.0 and high > 0.0:
        return f"unstable, by a gain {-20.0 * math.log10(high):.1f} dB too high"
    if 1.0 < low < math.inf:
        return f"unstable, by a gain {20.0 * math.log10(low):.1f} dB too low"
    return "unstable, and no common factor of the gains was found to mend it"


def _seen(loop: Record, *, stable: bool) -> str:
    """What the engine itself does, where that is more than the linear loop says."""
    if "problem" in loop:
        return f"the engine was not run: {loop['problem']['detail']}"
    unfinished = _unfinished(loop)
    if unfinished:
        return unfinished
    outcome = loop.get("outcome")
    if outcome == "limit-cycle":
        cycle = loop["limit_cycle"]
        return f"the engine hunts between {cycle['low_rad_s']:.1f} and {cycle['high_rad_s']:.1f} rad/s, every {cycle['period_s']:.3f} s"
    if outcome in {"stalled", "diverged"}:
        return f"the engine {loop.get('summary', outcome)}"
    return _rest(loop, stable=stable) if outcome == "settled" and "steady_error_rad_s" in loop else ""


def _unfinished(loop: Record) -> str:
    """What is to be said of a run that ended before its time, or does not tell how it ends."""
    if "ended" in loop:
        return f"the engine {loop['ended']}"
    if "still_moving" in loop:
        return "after the load's step the engine still moves away at the end of the time shown"
    return "on the engine the time shown does not tell yet how it ends: show more" if "undecided" in loop else ""


def _rest(engine: Record, *, stable: bool) -> str:
    """What is to be said of an engine that comes to rest."""
    if not stable:
        return "the engine comes to rest all the same, at another speed or at a limit of the throttle"
    off = abs(engine["steady_error_rad_s"])
    if off > 0.02 * abs(engine["command_rad_s"]):
        return f"the engine rests {off:.3g} rad/s off its target"
    settled = engine.get("settling_time_s", 0.0)
    return f"the engine comes to rest after {settled:.3g} s, later than is shown" if settled > engine["time_s"][-1] else ""


def _fooled(margins: Record, promises: Record) -> str:
    """What the models without delay would have told."""
    models = {name: promises.get(name, {}) for name in ("g1", "g2")}
    known = {name: found for name, found in models.items() if "stable" in found}
    if not margins["stable"]:
        wrong = [NAMES[name] for name, found in known.items() if found["stable"]]
        return f"{' and '.join(wrong)} would have called it stable" if wrong else ""
    rise = margins.get("gain_margin_db")
    if rise is None:
        return ""
    blind = [name for name, found in known.items() if found["stable"] and found.get("gain_margin_db", math.inf) > rise + 6.0]
    return f"{NAMES[blind[-1]]} would not have told you" if blind else ""


def _point_lines(point: Record) -> Iterator[str]:
    yield (
        f"At rest at {point['throttle_deg']:.4g} deg: {point['speed_rad_s']:.1f} rad/s ({point['speed_rpm']:.0f} rpm), "
        f"{point['pressure_kpa']:.1f} kPa; torque follows the intake {1e3 * point['lags_s']['charge']:.1f} ms late."
    )
    yield from (f"{remark[:1].upper()}{remark[1:]}." for remark in point.get("warnings", ()))


def _model_lines(promises: Record) -> Iterator[str]:
    if "problem" in promises:
        yield f"The models promise nothing: {promises['problem']['detail']}."
        return
    reasons = {name: found.get("problem", "").split(";")[0].replace(f"of {name} ", "") for name, found in promises.items()}
    if "" not in reasons.values() and len(set(reasons.values())) == 1:
        yield f"The models promise nothing: {next(iter(reasons.values()))}."
        return
    for name, found in promises.items():
        if reasons[name]:
            yield f"{NAMES[name].capitalize()} promises nothing: {reasons[name]}."
        elif not found["stable"]:
            yield f"{NAMES[name].capitalize()} calls the loop unstable."
        else:
            rise = found.get("gain_margin_db")
            room = "any gain" if rise is None else f"{rise:.1f} dB more gain"
            yield f"{NAMES[name].capitalize()} promises {room}, Ms {found['ms']:.2f}."


def _engine_lines(margins: Record, loop: Record) -> Iterator[str]:
    engine = {} if "problem" in loop else loop
    if margins.get("no_control") and margins["stable"]:
        yield f"Left alone it comes to rest with a time constant of {-1.0 / margins['slowest_root_rad_s'][0]:.2g} s."
    if "summary" in engine:
        yield f"The engine {engine['summary']}."
    if "reason" in engine:
        yield f"The run ended early. {engine['reason'][:1].upper()}{engine['reason'][1:]}."
    if engine.get("saturated_share", 0.0) > 0.0:
        yield f"The throttle is at a limit {100.0 * engine['saturated_share']:.0f} % of the time."
    if "droop_rad_s" in engine:
        seen = ", as far as it is shown" if "ended" in engine or "still_moving" in engine else " at most"
        yield f"After the load's step the speed moves by {engine['droop_rad_s']:.2f} rad/s{seen}."
    if "delay_margin_s" in margins and margins.get("stable"):
        yield f"The loop stands {1e3 * margins['delay_margin_s']:.1f} ms more delay."
