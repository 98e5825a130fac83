"""The exact linear loop at each place of an acceptance, as the samples see it: whether it is run, and what is unusual about it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim
from revline.design.controllers.scheduled_pid import AnyController, ScheduledController
from revline.design.loops.linear_verdict import judge_linear_system
from revline.design.plants.loop_signals import LoopSignals
from revline.design.stability.discrete_loop import DiscreteMargins, find_discrete_margins, sampled_plant_of_system
from revline.system import DelaySystem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearLoop:
    """The exact linear loop at a place, as the samples see it.

    Attributes:
        place: inputs at the trim, by name.
        margins: with sampling and hold as they are.
        delay: longest lag of the plant there, in s.
        remedy: where it is unstable, with which multiple of its gains it would be stable, as the end of a sentence; else empty.
        outside: what is to be said of a place outside the gain schedule; empty where it is within, or gains are fixed.
    """

    place: Mapping[str, float]
    margins: DiscreteMargins
    delay: float
    remedy: str = ""
    outside: str = ""

    @property
    def gain_margin(self) -> float | None:
        """By which factor all gains may rise; nothing where there is no such limit."""
        rise = self.margins.margins.gain_rise
        return None if rise is None else rise.gain_margin

    @property
    def warning(self) -> str:
        """What is unusual about it; empty where nothing is."""
        found = [self.outside] if self.outside else []
        if self.margins.period > self.delay:
            found.append(
                f"the controller samples every {self.margins.period:g} s, longer than the plant's delay of {self.delay:.3g} s; the "
                "loop waits for the controller more than for the plant: sample faster"
            )
        return f"{self._words}: {'; '.join(found)}" if found else ""

    @property
    def verdict(self) -> str:
        """Why it is not run; empty where it is stable."""
        margins = self.margins.margins
        if margins.stable:
            return ""
        roots = "1 root" if margins.unstable_poles == 1.0 else f"{margins.unstable_poles:g} roots"
        return f"{self._words}: the linear loop is unstable, with {roots} outside the unit circle{self.remedy}"

    @property
    def _words(self) -> str:
        return ", ".join(f"{name} {value:g}" for name, value in self.place.items())


def find_linear_loop(
    plant: DelaySystem, trim: Trim, controller: AnyController, place: Mapping[str, float], wires: LoopSignals
) -> LinearLoop:
    """Find the margins of the exact linear loop at a place, as its samples see it.

    Args:
        plant: nonlinear, with its delays.
        trim: at the place.
        controller: sampled; a scheduled one counts with the gains of the place.
        place: inputs at the trim, by name.
        wires: which signals close the loop.

    Raises:
        InvalidInputError, NotConvergedError: as for `find_discrete_margins`.
    """
    speed, outside = trim.output(wires.measurement), ""
    if isinstance(controller, ScheduledController):  # at rest its linear model is that with the gains of the place
        second = trim.input(controller.schedule.names[1])
        local = controller.frozen_at(speed, second)
        outside = controller.schedule.outside(np.array([speed]), np.array([second]))
    else:
        local = controller
    model = linearize(plant, trim).model
    sampled = sampled_plant_of_system(model, wires=wires, name=plant.name)
    margins = find_discrete_margins(sampled, local, speed=speed)
    remedy = "" if margins.margins.stable else judge_linear_system(plant, trim, local, wires=wires).remedy
    delay = float(max(model.lags, default=0.0))
    return LinearLoop(place=place, margins=margins, delay=delay, remedy=remedy, outside=outside)
