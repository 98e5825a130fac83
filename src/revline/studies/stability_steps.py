"""The study's step on stability: every loop judged with the delay exact, on the fitted models and on the engine's exact linear model."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.controller import PidGains
from revline.design.regions.gain_curve import LoopFamily
from revline.design.regions.gain_region import GainRegion, Window, find_gain_region, find_window
from revline.design.regions.loop_family import family_of_model, family_of_system
from revline.design.regions.sensitivity_contour import find_sensitivity_contour
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model, open_loop_of_system
from revline.errors import AnalysisError, RevlineError
from revline.lti.state_space import DelayStateSpace
from revline.lti.transfer_function import TransferFunction
from revline.studies.results import ControllersResult, LoopsResult, ModelsResult, PointResult, title
from revline.studies.stability_results import AT_START, AT_TARGET, MarginRow, NoMargins, NoRegion, PeakContour, RegionRow, StabilityResult
from revline.system import DelaySystem

CONTROLLERS = ("c1", "c2", "c2d")
MODELS = ("g1", "g2", "g2d")

PEAKS = (1.4, 2.0, 3.0)
"""Peaks of the sensitivity whose contours are drawn: cautious, bold, and hardly safe. Source: Astrom and Hagglund (2006), section 4.6."""

ROOM = 1.25
"""Windows reach so far beyond the gains that they must hold."""

Plant = TransferFunction | DelayStateSpace


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plants:
    """The plants that controllers are judged with, by name: fitted models and the engine's exact linear models."""

    by_name: Mapping[str, Plant]

    def family(self, name: str, kd: float) -> LoopFamily:
        """A plant under all PI controllers with one derivative gain."""
        plant = self.by_name[name]
        if isinstance(plant, TransferFunction):
            return family_of_model(plant, kd=kd, name=title(name))
        return family_of_system(plant, kd=kd, name=name)

    def loop(self, name: str, gains: PidGains) -> OpenLoop:
        """The loop of a plant and a controller, broken at the throttle."""
        plant = self.by_name[name]
        if isinstance(plant, TransferFunction):
            return open_loop_of_model(plant, gains, name=title(name))
        return open_loop_of_system(plant, gains, name=name)


def find_target(engine: DelaySystem, point: PointResult, loops: LoopsResult) -> tuple[Trim, ...]:
    """Find the steady state that the command leads to; nothing where the engine has none at that speed."""
    trim = point.trim
    try:
        held = {"engine_speed": trim.output("engine_speed") + loops.command}
        return (find_trim(engine, inputs={"load_torque": trim.input("load_torque")}, outputs=held, free=("throttle",)),)
    except AnalysisError:
        return ()


def collect_plants(engine: DelaySystem, point: PointResult, models: ModelsResult, target: tuple[Trim, ...]) -> Plants:
    """The fitted models, and the engine's exact linear model where the loops start and where they are led to."""
    plants: dict[str, Plant] = {name: models.fit(name).fit.model for name in MODELS}
    plants[AT_START] = linearize(engine, point.trim).model
    for trim in target:
        plants[AT_TARGET] = linearize(engine, trim).model
    return Plants(by_name=plants)


def find_stability(
    engine: DelaySystem, point: PointResult, models: ModelsResult, controllers: ControllersResult, loops: LoopsResult
) -> StabilityResult:
    """Find the margins of every controller with every plant, and the gains that stabilise each plant at each controller's kd."""
    target = find_target(engine, point, loops)
    plants = collect_plants(engine, point, models, target)
    margins = [_margins(plants, name, plant, controllers.gains[name]) for name in CONTROLLERS for plant in plants.by_name]
    regions = [row for kd in dict.fromkeys(controllers.gains[name].kd for name in CONTROLLERS) for row in _regions(plants, kd, controllers)]
    return StabilityResult(
        target=target,
        margins=tuple(row for row in margins if isinstance(row, MarginRow)),
        without_margins=tuple(row for row in margins if isinstance(row, NoMargins)),
        regions=tuple(row for row in regions if isinstance(row, RegionRow)),
        without_region=tuple(row for row in regions if isinstance(row, NoRegion)),
    )


def _margins(plants: Plants, controller: str, plant: str, gains: PidGains) -> MarginRow | NoMargins:
    try:
        return MarginRow(controller, plant, find_margins(plants.loop(plant, gains)))
    except RevlineError as error:
        return NoMargins(controller, plant, str(error))


def controllers_with(controllers: ControllersResult, kd: float) -> dict[str, PidGains]:
    """The controllers that are shown in the plane of kp and ki at one kd, by name."""
    shown = (*CONTROLLERS, "c2d_reduced")
    return {name: gains for name, gains in controllers.gains.items() if name in shown and gains.kd == kd}


def _regions(plants: Plants, kd: float, controllers: ControllersResult) -> Iterator[RegionRow | NoRegion]:
    marks = controllers_with(controllers, kd)
    window = _window(plants, kd, marks)
    for plant in plants.by_name:
        try:
            yield _region(plants.family(plant, kd), plant, window, marks)
        except RevlineError as error:
            yield NoRegion(plant, kd, str(error))


def _window(plants: Plants, kd: float, marks: Mapping[str, PidGains]) -> Window:
    """One window for all plants, that shows the whole region of the engine's exact models and every controller."""
    found = []
    for plant in (name for name in (AT_START, AT_TARGET) if name in plants.by_name):
        try:
            found.append(find_window(plants.family(plant, kd)))
        except RevlineError:  # that there is no region is said, with this reason, when it is looked for in the window
            continue
    high = ROOM * max([w.kp_high / 1.1 for w in found] + [gains.kp for gains in marks.values()])
    top = ROOM * max([w.ki_high / 1.1 for w in found] + [gains.ki for gains in marks.values()])
    low = min([w.kp_low for w in found] + [-0.1 * high])
    return Window(kp_low=low, kp_high=high, ki_high=top)


def _region(family: LoopFamily, plant: str, window: Window, marks: Mapping[str, PidGains]) -> RegionRow:
    region = find_gain_region(family, window)
    stable = {name: bool(region.stabilises(gains.kp, gains.ki)) for name, gains in marks.items()}
    return RegionRow(
        plant=plant,
        kd=family.kd,
        window=window,
        bounded=region.bounded,
        intervals=region.kp_ends(),
        omega=region.omega[region.rim],
        kp=region.kp[region.rim],
        ki=region.ki[region.rim],
        run=np.cumsum(np.diff(region.rim, prepend=False))[region.rim] // 2,
        contours=tuple(_contour(region, peak) for peak in PEAKS) if plant == AT_TARGET and not region.empty else (),
        inside=tuple(name for name, good in stable.items() if good),
        outside=tuple(name for name, good in stable.items() if not good),
    )


def _contour(region: GainRegion, peak: float) -> PeakContour:
    found = find_sensitivity_contour(region, peak)
    return PeakContour(peak=peak, kp=found.kp, ki=found.ki, piece=found.piece)
