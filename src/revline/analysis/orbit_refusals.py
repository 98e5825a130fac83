"""Why an orbit is refused: a state leaves its range, a channel delivers nothing, there is no fundamental, or no orbit was found."""

from dataclasses import dataclass

import numpy as np

from revline.analysis.collocation import Collocation
from revline.analysis.jacobians import evaluate
from revline.analysis.orbit_equations import Orbits
from revline.analysis.orbit_newton import Drive
from revline.analysis.periodic import Excitation
from revline.errors import AnalysisError, LagError, NotConvergedError, RevlineError
from revline.lti.state_space import DelayStateSpace
from revline.system import DelaySystem, Floats, Variable

Refusals = dict[int, RevlineError]
"""Errors by the position of their orbit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForcedCase:
    """Which orbits are asked for, and how finely.

    Attributes:
        system: any system with delay channels.
        excitation: names of what is moved and watched; the amplitudes are those of the drive.
        drive: the sinusoids.
        model: small-signal model about the drive's trim.
        tolerance: largest estimated relative error of the fundamental by the harmonics left out.
        most_harmonics: highest harmonic at most.
        seek_limits: whether a refusal is to tell up to which amplitude there is an orbit.
    """

    system: DelaySystem
    excitation: Excitation
    drive: Drive
    model: DelayStateSpace
    tolerance: float
    most_harmonics: int
    seek_limits: bool = False

    @property
    def step_tolerance(self) -> float:
        """Largest last step of an orbit that is found: the error left is smaller still."""
        return min(1e-5, max(1e-11, 0.5 * self.tolerance))


def refuse_orbits(case: ForcedCase, mesh: Collocation, orbits: Orbits) -> Refusals:
    """Refuse orbits on which the model means nothing, or a channel delivers backwards in time."""
    system = case.system
    lags = evaluate(system, system.lags, orbits.states, orbits.inputs, orbits.readings)
    advance = 1.0 - (mesh.derivative @ lags) * orbits.omega[:, None, None]
    refused: Refusals = {}
    for k, variable in enumerate(system.channels):
        for what, values, unit in (("its lag", lags[..., k], "s"), ("the rate of its delayed time", advance[..., k], "s/s")):
            for row in np.flatnonzero(~np.all(values > 0.0, axis=1)).tolist():
                refused[row] = _no_delivery(case, variable, row, f"{what} falls to {np.min(values[row]):g} {unit} (limit 0)")
    for k, variable in enumerate(system.states):
        values = orbits.states[..., k]
        outside = np.flatnonzero(~np.all((values >= variable.low) & (values <= variable.high), axis=1))
        refused |= {int(row): _beyond(case, variable, int(row), values[row]) for row in outside}
    return refused


def no_fundamental(case: ForcedCase, row: int) -> RevlineError:
    """Say that the watched output of an orbit does not answer."""
    omega = float(case.drive.omega[row])
    message = (
        f"output {case.excitation.output_name} of {case.system.name} has no fundamental under input {case.excitation.input_name} at "
        f"{omega:g} rad/s: it does not answer, or with other harmonics alone; choose another output, trim or amplitude"
    )
    return AnalysisError(message, frequency=omega)


def not_found(case: ForcedCase, row: int, reached: float) -> RevlineError:
    """Say up to which part of its amplitude an orbit was followed."""
    omega, amplitude = float(case.drive.omega[row]), float(case.drive.amplitude[row])
    unit = case.system.inputs[case.drive.position].unit
    message = (
        f"no periodic answer of {case.system.name} found at {omega:g} rad/s with {amplitude:g} {unit} amplitude of "
        f"{case.excitation.input_name}: there is one up to {reached * amplitude:.4g} {unit}; choose a smaller amplitude, or "
        "simulate it"
    )
    return NotConvergedError(message, frequency=omega, amplitude=reached * amplitude)


def with_limit(case: ForcedCase, row: int, reached: float, reason: RevlineError) -> RevlineError:
    """Say in a refusal beyond a part of an amplitude that up to there is an orbit."""
    unit, amplitude = case.system.inputs[case.drive.position].unit, reached * float(case.drive.amplitude[row])
    return type(reason)(f"{reason}: there is an orbit up to {amplitude:.4g} {unit}", **{**reason.details, "amplitude": amplitude})


def _no_delivery(case: ForcedCase, variable: Variable, row: int, why: str) -> RevlineError:
    omega = float(case.drive.omega[row])
    message = (
        f"channel {variable.name} of {case.system.name} delivers nothing on the orbit at {omega:g} rad/s: {why}; choose a smaller "
        f"amplitude than {case.drive.amplitude[row]:g}"
    )
    return LagError(message, frequency=omega, channel=variable.name)


def _beyond(case: ForcedCase, variable: Variable, row: int, values: Floats) -> RevlineError:
    omega, low, high = float(case.drive.omega[row]), float(np.min(values)), float(np.max(values))
    message = (
        f"{variable.name} of {case.system.name} goes from {low:g} to {high:g} {variable.unit} on the orbit at {omega:g} rad/s, outside "
        f"its range of {variable.low:g} to {variable.high:g} {variable.unit}; choose a smaller amplitude than "
        f"{case.drive.amplitude[row]:g}"
    )
    return AnalysisError(message, frequency=omega, low=low, high=high)
