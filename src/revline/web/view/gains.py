"""Gains that stabilise, margins and characteristic roots, for a view."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final

import numpy as np

from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import PidController
from revline.design.loops.linear_verdict import judge_linear_system
from revline.design.regions.gain_region import GainRegion, find_gain_region
from revline.design.regions.loop_family import family_of_system
from revline.design.regions.sensitivity_contour import find_sensitivity_contour
from revline.design.stability.linear_loop import closed_loop_transfer
from revline.design.stability.margins import Margins, find_margins, find_margins_each
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model, open_loop_of_system
from revline.errors import RevlineError
from revline.io.margin_records import margin_record
from revline.lti.interconnection import feed_back, to_state_space
from revline.lti.roots import characteristic_roots
from revline.lti.transfer_function import TransferFunction
from revline.web.plants import (
    MODELS,
    Place,
    Point,
    check_amplitude,
    check_influence,
    find_point,
    fit_model,
    gains_of,
    has_control,
    loop_with_model,
    place_of,
)
from revline.web.state import State
from revline.web.view.drawing import drawn

CONTOURS: Final = (1.4, 2.0, 3.0)
"""Peak sensitivities whose contours are drawn."""

COLUMNS, ROWS = 90, 60
"""Gains in each direction at which the shaded area is counted; its edge is the exact boundary."""


def view_gains(state: State) -> Mapping[str, Any]:
    """Give the (kp, ki) that stabilise the exact loop at the state's kd: the boundary for drawing, and where the state's gains lie."""
    place = place_of(state)
    check_influence(state, find_point(place))
    region = _region(place, state.kd)
    window = region.window
    kp = np.linspace(window.kp_low, window.kp_high, COLUMNS)
    ki = np.linspace(0.0, window.ki_high, ROWS)
    stable = region.stabilises(kp[None, :], ki[:, None])
    area = region.area
    return {
        "kd": state.kd,
        "window": {"kp_low": window.kp_low, "kp_high": window.kp_high, "ki_high": window.ki_high},
        "bounded": region.bounded,
        "boundary": _pieces(region),
        "shade": [row.tobytes().decode("ascii") for row in np.where(stable, b"1", b"0")],
        "kp_intervals_without_integral": [list(ends) for ends in region.kp_ends()],
        "area": {"value": area.value, "error": area.error},
    }


def _pieces(region: GainRegion) -> list[dict[str, Any]]:
    """The stretches of the curve that bound the region, for drawing."""
    at = np.flatnonzero(region.rim)
    cuts = np.flatnonzero(np.diff(at) > 1) + 1
    return [{"kp": drawn(region.kp[piece]), "ki": drawn(region.ki[piece])} for piece in np.split(at, cuts) if piece.size]


def view_contours(state: State) -> Mapping[str, Any]:
    """Give curves of equal peak sensitivity in the window of the region."""
    place = place_of(state)
    check_influence(state, find_point(place))
    region = _region(place, state.kd)
    found: list[dict[str, Any]] = []
    for peak in CONTOURS:
        try:
            contour = find_sensitivity_contour(region, peak)
        except RevlineError as error:
            found.append({"ms": peak, "none": str(error)})
            continue
        if not contour.kp.size:
            found.append({"ms": peak, "none": f"at kd = {state.kd:g} no gains shown have a peak sensitivity of {peak:g}"})
            continue
        cuts = np.flatnonzero(np.diff(contour.piece) != 0) + 1
        pieces = [{"kp": drawn(p), "ki": drawn(i)} for p, i in zip(np.split(contour.kp, cuts), np.split(contour.ki, cuts), strict=True)]
        found.append({"ms": peak, "pieces": pieces, "largest_deviation": contour.deviation})
    return {"contours": found}


def view_margins(state: State) -> Mapping[str, Any]:
    """Give the margins of the exact loop as `revline margins --json` does; without any gain, what the engine alone does."""
    place, gains = place_of(state), gains_of(state)
    point = find_point(place)
    if not has_control(state):
        return _uncontrolled(point)
    check_influence(state, point)
    found = _exact_margins(place, gains.kp, gains.ki, gains.kd)
    record = dict(margin_record(found, gains))
    if found.stable:
        return record  # a nearest crossover of an unstable loop need not make it stable: count the roots beyond
    stable_range = judge_linear_system(point.engine, point.trim, PidController(gains=gains)).stable_range
    return record if stable_range is None else record | {"stable_factors": list(stable_range)}


def _uncontrolled(point: Point) -> Mapping[str, Any]:
    """What there is to say where nothing controls the speed: how fast it comes to rest, and what a load does to it."""
    slowest = point.trim.roots.roots[0]
    return {
        "no_control": True,
        "stable": point.trim.stable,
        "slowest_root_rad_s": [float(slowest.real), float(slowest.imag)],
        "load_gain_rad_s_per_n_m": point.linear.model.static_gain("load_torque", "engine_speed"),
    }


def view_loop_roots(state: State) -> Mapping[str, Any]:
    """Give the right-most characteristic roots of the loop with the exact plant, every delay kept; without any gain, those of the plant."""
    place, gains = place_of(state), gains_of(state)
    point = find_point(place)
    if not has_control(state):
        return {"roots_rad_s": _pairs(point.trim.roots.roots)}
    check_influence(state, point)
    return {"roots_rad_s": _pairs(_exact_loop(place, gains.kp, gains.ki, gains.kd).closed_roots)}


def view_promises(state: State) -> Mapping[str, Any]:
    """Give the margins that each fitted model promises; none without any gain."""
    check_amplitude(state, find_point(place_of(state)))
    return _promises(state, lambda name: loop_with_model(state, name))


def promises_of(state: State, models: Mapping[str, TransferFunction]) -> Mapping[str, Any]:
    """Give the margins that models promise which were fitted already, as `view_promises` does.

    Args:
        state: whose models they are.
        models: the transfer function of each.
    """
    gains = gains_of(state)
    return _promises(state, lambda name: open_loop_of_model(models[name], gains))


def _promises(state: State, loop_of: Callable[[str], OpenLoop]) -> Mapping[str, Any]:
    loops: dict[str, OpenLoop | RevlineError] = {}
    for name in MODELS if has_control(state) else ():
        try:
            loops[name] = replace(loop_of(name), name=f"of {name} under these gains")
        except RevlineError as error:
            loops[name] = error
    found = iter(find_margins_each([loop for loop in loops.values() if isinstance(loop, OpenLoop)]))
    return {name: _promise(next(found) if isinstance(loop, OpenLoop) else loop) for name, loop in loops.items()}


def view_roots(state: State) -> Mapping[str, Any]:
    """Give the right-most characteristic roots of the exact plant, and each model's poles with the right-most ones of its loop.

    A model that cannot be fitted is left out here; the part `models` says why.
    """
    place, gains = place_of(state), gains_of(state)
    point = find_point(place)
    models: dict[str, Any] = {}
    for name in MODELS:
        try:
            model = fit_model(place, state.amplitude_deg, name).fit.model
        except RevlineError:
            continue
        models[name] = {"poles": _pairs(model.poles), **_closed(model, gains)}
    return {"plant": _pairs(point.trim.roots.roots), "models": models}


def _closed(model: TransferFunction, gains: PidGains) -> dict[str, Any]:
    """Poles of the loop with a model: all of them without delay, the right-most ones with it; left out where there are none to tell."""
    if model.delay == 0.0:
        return {"closed": _pairs(closed_loop_transfer(model, gains).poles)}
    above, below = ((gains.ki, gains.kp, gains.kd), (0.0, 1.0)) if gains.ki else ((gains.kp, gains.kd), (1.0,))
    if not any(above):
        return {"closed": _pairs(model.poles)}
    try:
        opened = TransferFunction(
            numerator=tuple(np.trim_zeros(np.convolve(model.numerator, above), "b").tolist()),
            denominator=tuple(np.convolve(model.denominator, below).tolist()),
            delay=model.delay,
        )
        return {"closed": _pairs(characteristic_roots(feed_back(to_state_space(opened), [[-1.0]])).roots)}
    except RevlineError:  # no end of roots to the right, or none that settle
        return {}


def _pairs(roots: Any) -> list[list[float]]:
    return [[float(root.real), float(root.imag)] for root in np.asarray(roots)]


@lru_cache(maxsize=64)
def _region(place: Place, kd: float) -> GainRegion:
    point = find_point(place)
    return find_gain_region(family_of_system(point.linear.model, kd=kd, name=point.engine.name, roots=point.trim.roots))


@lru_cache(maxsize=64)
def _exact_loop(place: Place, kp: float, ki: float, kd: float) -> OpenLoop:
    point = find_point(place)
    gains = PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="the workbench")
    name = f"{point.engine.name} at {point.trim.input('throttle'):g} deg, {place.load:g} N m under these gains"
    return replace(open_loop_of_system(point.linear.model, gains), name=name)


@lru_cache(maxsize=64)
def _exact_margins(place: Place, kp: float, ki: float, kd: float) -> Margins:
    return find_margins(_exact_loop(place, kp, ki, kd))


def _promise(found: Margins | RevlineError) -> dict[str, Any]:
    if isinstance(found, RevlineError):
        return {"problem": str(found)}
    record: dict[str, Any] = {"stable": found.stable, "ms": found.sensitivity.value}
    if found.gain_rise is not None:
        record["gain_margin"] = found.gain_rise.gain_margin
        record["gain_margin_db"] = found.gain_rise.gain_margin_db
    if found.phase is not None:
        record["phase_margin_deg"] = found.phase.phase_margin_deg
    if found.delay is not None and math.isfinite(found.delay.delay_margin):
        record["delay_margin_s"] = found.delay.delay_margin
    return record
