"""Why a run could not go on, in words: with time, states and lags."""

import math

from revline.dde.run import BY_STATE, Record
from revline.dde.sampling import MOST_CORRECTIONS
from revline.errors import DivergedError, LagError, SimulationError, StalledError, StepError
from revline.system import DelaySystem


def explain(system: DelaySystem, s: Record) -> SimulationError:
    """Build the error for a run whose last tried step meant nothing; the run's state `s` holds the step and the present before it."""
    time, end = float(s["time"]), float(s["end"])
    n, c = len(system.states), len(system.channels)
    present = dict(zip((v.name for v in system.states), map(float, s["x"][:n]), strict=True))
    lags = dict(zip((f"lag of {v.name}" for v in system.channels), (time - float(r) for r in s["read_time"][:c]), strict=True))
    values = ", ".join(f"{v.name} = {present[v.name]:g} {v.unit}" for v in system.states)
    ages = ", ".join(f"{name} = {lag:g} s" for name, lag in lags.items())
    place = f"{system.name} at t = {time:g} s ({'; '.join(text for text in (values, ages) if text)})"
    details = {"time": time, **present, **lags}
    tried = [(v, float(x)) for v, x in zip(system.states, s["x_next"][:n], strict=True)]
    if s["sampling"] == BY_STATE and s["corrections"] >= MOST_CORRECTIONS and math.isnan(s["x_next"][int(s["sampled_state"])]):
        name = system.states[int(s["sampled_state"])].name
        message = (
            f"{place}: the time at which {name} passes {float(s['state_target']):g}, of the next sample, is not found in {MOST_CORRECTIONS}"
            " corrections: its rate jumps; give a smaller step"
        )
        return SimulationError(message, state=name, **details)
    lost = [v.name for v, x in tried if not math.isfinite(x)]
    if lost:
        return DivergedError(
            f"diverged: {place}: {', '.join(lost)} is no finite number any more; give smaller gains or a smaller step", **details
        )
    gone = [(v, x) for v, x in tried if not v.low <= x <= v.high]
    if gone:
        said = "; ".join(f"{v.name} goes to {x:g} {v.unit}, outside {v.low:g} to {v.high:g} {v.unit}" for v, x in gone)
        message = f"stalled: {place}: {said}; give more throttle, less load or smaller gains"
        return StalledError(message, state=gone[0][0].name, value=gone[0][1], **details)
    return _explain_lags(system, s, place, end, details)


def _explain_lags(system: DelaySystem, s: Record, place: str, end: float, details: dict[str, float]) -> LagError:
    step, c = float(s["step"]), len(system.channels)
    following = [(v.name, end - float(r)) for v, r in zip(system.channels, s["read_time_next"][:c], strict=True)]
    for name, lag in following:
        if not (math.isfinite(lag) and lag > 0.0):
            return LagError(f"{place}: the lag of {name} becomes {lag:g} s; lags must be positive: check their equation", **details)
    for name, lag in following:
        if lag < step:
            what = f"step = {step:g} s is longer than a lag during the run, {lag:g} s of {name}"
            return StepError(f"{what}: {place}; give a smaller step", **details)
    advances = [float(after - before) for before, after in zip(s["read_time"][:c], s["read_time_next"][:c], strict=True)]
    name, lag = following[advances.index(min(advances))]
    what = f"the delayed time runs backwards, the lag of {name} grows to {lag:g} s faster than time passes"
    return LagError(f"stalled: {place}: {what}; give more throttle or less load", **details)
