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
    lines = [*_point_lines(point), *_model_lines(promises), *_engine_lines(margins, loop)]
    return {"verdict": verdict(point, margins, promises, loop), "lines": lines}


def verdict(point: Record, margins: Record, promises: Record, loop: Record) -> str:
    """Say in one line how the loop is: by its exact linear model, on the engine, and what the models without delay would have said."""
    if "problem" in margins:
        return f"nothing can be said of the loop: {margins['problem']['detail']}"
    parts = [f"with the controller {_stability(margins)}" if loop.get("open_loop") else _stability(margins)]
    seen = _seen(loop, stable=bool(margins["stable"]))
    if seen:
        parts.append(seen)
    fooled = _fooled(margins, promises)
    if fooled:
        parts.append(fooled)
    if not point["stable"]:
        parts.append("the engine alone is unstable here")
    return "; ".join(parts)


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
        return f"on the engine: {loop.get('summary', outcome)}"
    return _rest(loop, stable=stable) if outcome == "settled" and "steady_error_rad_s" in loop else ""


def _unfinished(loop: Record) -> str:
    """What is to be said of a run that ended before its time, or does not tell how it ends."""
    if "ended" in loop:
        return f"on the engine: {loop['ended']}"
    if "still_moving" in loop:
        return "after the load's step the engine still moves away at the end of the time shown"
    return "on the engine the time run does not tell how it ends" if "undecided" in loop else ""


def _rest(engine: Record, *, stable: bool) -> str:
    """What is to be said of an engine that comes to rest."""
    if not stable:
        return "the engine comes to rest all the same, at another speed or at a limit of the throttle"
    off = abs(engine["steady_error_rad_s"])
    return f"the engine rests {off:.3g} rad/s off its target" if off > 0.02 * abs(engine["command_rad_s"]) else ""


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
    if not point["stable"]:
        yield f"The engine alone is unstable there ({point['unstable_roots']} roots right of the imaginary axis)."


def _model_lines(promises: Record) -> Iterator[str]:
    for name, found in promises.items():
        if name not in NAMES:
            continue
        if "problem" in found:
            yield f"{NAMES[name].capitalize()} promises nothing: {found['problem']}"
        elif not found["stable"]:
            yield f"{NAMES[name].capitalize()} calls the loop unstable."
        else:
            rise = found.get("gain_margin_db")
            room = "any gain" if rise is None else f"{rise:.1f} dB more gain"
            yield f"{NAMES[name].capitalize()} promises {room}, Ms {found['ms']:.2f}."


def _engine_lines(margins: Record, loop: Record) -> Iterator[str]:
    engine = {} if "problem" in loop else loop
    if "summary" in engine:
        yield f"The engine {engine['summary']}."
    if engine.get("saturated_share", 0.0) > 0.0:
        yield f"The throttle is at a limit {100.0 * engine['saturated_share']:.0f} % of the time."
    if "droop_rad_s" in engine:
        seen = ", as far as it is shown" if "ended" in engine or "still_moving" in engine else " at most"
        yield f"After the load's step the speed moves by {engine['droop_rad_s']:.2f} rad/s{seen}."
    if "delay_margin_s" in margins and margins.get("stable"):
        yield f"The loop stands {1e3 * margins['delay_margin_s']:.1f} ms more delay."
