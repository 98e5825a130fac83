"""Which signals close a loop around a plant, and the point of rest that it starts from."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.analysis.trim import Trim

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopSignals:
    """Names of the signals that close a loop: what the controller drives, what it measures, and that signal's rate."""

    drive: str
    measurement: str
    measurement_rate: str


SPEED_BY_THROTTLE = LoopSignals(drive="throttle", measurement="engine_speed", measurement_rate="engine_acceleration")
"""Engine speed controlled by the throttle."""

OF_LINEAR_MODEL = LoopSignals(drive="input", measurement="output", measurement_rate="output_rate")
"""The signals of `linear_plant`."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OperatingPoint:
    """Where a loop starts: states, inputs and measurement at rest."""

    states: Floats
    inputs: Mapping[str, float]
    measurement: float


def operating_point(trim: Trim, wires: LoopSignals = SPEED_BY_THROTTLE) -> OperatingPoint:
    """Start a loop from a trim."""
    inputs = {variable.name: trim.input(variable.name) for variable in trim.input_variables}
    return OperatingPoint(states=trim.states, inputs=inputs, measurement=trim.output(wires.measurement))
