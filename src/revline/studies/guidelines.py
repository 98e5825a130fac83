"""Guidelines for the speed controller, as text made from the study's numbers. Source of the questions: Lee (1995), chapter 6."""

from collections.abc import Iterator

from revline.analysis.linearize import linearize
from revline.design.loops.closed_loop import LoopRun, describe_outcome
from revline.design.loops.outcome import Stalled
from revline.design.regions.gain_rays import GainLimit, NoGainLimit, find_gain_limit
from revline.design.regions.loop_family import family_of_model, family_of_system
from revline.studies.operating_map import box_words
from revline.studies.results import title
from revline.studies.study_results import StudyResults
from revline.studies.trials import PERIOD, SPREAD, trial_words
from revline.studies.words import misses, outcome_text
from revline.system import DelaySystem

SEARCH_TO = 1e4
"""Highest frequency at which a gain limit is looked for, in rad/s."""

ALIKE = 0.1
"""Overshoots that differ by no more of the command count as foreseen."""


def find_limits(engine: DelaySystem, results: StudyResults) -> tuple[tuple[str, GainLimit | NoGainLimit, GainLimit | NoGainLimit], ...]:
    """Find gain limits of the linear models and of the engine's exact linear model: proportional control, and with C1's ratio ki/kp."""
    c1 = results.controllers.gains["c1"]
    families = [(name, family_of_model(results.models.fit(name).fit.model, name=name)) for name in ("g1", "g2", "g2d")]
    if results.point.trim.stable:  # a gain limit is that of a plant that is stable by itself
        families.append(("engine, exact", family_of_system(linearize(engine, results.point.trim).model, name="the engine")))
    rows = []
    for name, family in families:
        alone, with_integral = (find_gain_limit(family, integral_ratio=ratio, high=SEARCH_TO) for ratio in (0.0, c1.ki / c1.kp))
        rows.append((name, alone, with_integral))
    return tuple(rows)


def write_guidelines(engine: DelaySystem, results: StudyResults) -> tuple[str, ...]:
    """Write the guidelines; each sentence holds the numbers that it rests on."""
    return tuple(_sentences(engine, results))


def _sentences(engine: DelaySystem, results: StudyResults) -> Iterator[str]:
    limits = {name: (alone, with_integral) for name, alone, with_integral in find_limits(engine, results)}
    ratio = results.controllers.gains["c1"].ki / results.controllers.gains["c1"].kp
    open_ended = {name: alone for name, (alone, _) in limits.items() if isinstance(alone, NoGainLimit)}
    without = [title(name) for name in open_ended]
    searched = min((limit.searched_to for limit in open_ended.values()), default=SEARCH_TO)
    if without:
        yield (
            f"{' and '.join(without)} set no upper limit to a proportional gain: their phase does not reach -180 deg up to "
            f"{searched:g} rad/s. On paper such a loop can be made as fast as one likes."
        )
    for name, (alone, integral) in limits.items():
        if isinstance(alone, GainLimit):
            text = f"{_title(name)} loses stability under proportional control at kp = {alone.kp:.3f} deg/(rad/s)"
            text += f", oscillating at {alone.frequency:.1f} rad/s"
            if isinstance(integral, GainLimit):
                text += f", and with C1's ratio ki/kp = {ratio:.2f} 1/s at kp = {integral.kp:.3f} deg/(rad/s)"
            yield text + "."
    loops, tau = results.loops, results.models.fit("g2d").fit.model.delay
    for controller, model in (("c1", "g1"), ("c2", "g2")):
        on_model, on_engine = loops.row(controller, model).run, loops.row(controller, "engine").run
        told = "told" if _foresees(on_model, on_engine) else "did not tell"
        yield (
            f"{title(controller)}, designed on {title(model)}, {_ended(on_model)} there; "
            f"on the engine it {_ended(on_engine)}. The model without delay {told}."
        )
    yield _of_c2d(loops.row("c2d", "g2d").run, loops.row("c2d", "engine").run, tau)
    yield _of_reduced(loops.row("c2d_reduced", "g2").run, loops.row("c2d_reduced", "engine").run, loops.row("c2d", "engine").run)
    yield (
        f"Use the model with its delay of {1e3 * tau:.1f} ms above {results.errors.equal_frequency:.0f} rad/s; "
        "below, the model without delay errs less in time. Near the speed at which the loop oscillates only the delay tells."
        if results.errors.equal_frequency > 0.0
        else f"Use the model with its delay of {1e3 * tau:.1f} ms."
    )
    yield from _of_holding(results)
    line = results.range.line
    yield (
        f"These hold about the operating point: over {line.low:g} to {line.high:g} deg the steady speed is a straight line within "
        f"{line.max_error:.2f} rad/s; the delay goes with 1/speed, so that gain limits fall at lower speed."
    )


def _of_holding(results: StudyResults) -> Iterator[str]:
    """What holds on the sampled engine, and over the map."""
    for name in ("c2d", "optimum"):
        trial = results.trials.trial(name)
        if trial is not None:
            yield f"Sampled every {1e3 * PERIOD:g} ms, with noise and on engines {100 * SPREAD:g} % off: {trial_words(trial)}"
    yield from (f"{box_words(box)} Beyond it schedule the gains." for box in results.operating_map.box if box.share < 1.0)


def _of_c2d(model: LoopRun, engine: LoopRun, delay: float) -> str:
    text = (
        f"C2d, designed on G2d with its delay of {1e3 * delay:.1f} ms, {_ended(model)} there; on the engine, without retuning, "
        f"it {_ended(engine)}"
    )
    if not (model.is_stable and engine.is_stable):
        return f"{text}."
    return f"{text}: the overshoot differs by {100.0 * abs(engine.overshoot - model.overshoot):.1f} percentage points."


def _of_reduced(model: LoopRun, engine: LoopRun, whole: LoopRun) -> str:
    """What a tenth of C2d's proportional gain does; more overshoot than with the whole gain is the slow oscillation."""
    outcomes = f"the engine {_ended(engine)}; on G2 the same loop {_ended(model)}"
    if engine.is_stable and engine.overshoot <= whole.overshoot:
        return f"With a tenth of C2d's proportional gain (ki and kd unchanged) {outcomes}."
    return (
        f"Too little proportional gain swings slowly: with a tenth of C2d's (ki and kd unchanged) {outcomes}. "
        "Lower the integral gain with the proportional one."
    )


def _foresees(model: LoopRun, engine: LoopRun) -> bool:
    """Whether a loop on a model ends as it does on the engine: both at rest, on or off target, with overshoots alike, or neither."""
    if not (model.is_stable and engine.is_stable):
        return model.is_stable == engine.is_stable
    if misses(model) != misses(engine):
        return False
    return abs(engine.overshoot - model.overshoot) <= ALIKE


def _ended(run: LoopRun) -> str:
    """How a loop ends, in words; where the engine stalls, its speed with a unit."""
    return outcome_text(run) if isinstance(run.outcome, Stalled) else describe_outcome(run)


def _title(name: str) -> str:
    return title(name) if name.startswith("g") else "The engine's exact linear model"
