"""One input against a step of the load: PI gains of the largest integral gain, and PID gains of the least IAE, both under Ms.

The derivative acts on the measurement's own rate, without a filter. For each derivative gain the gains whose sensitivity peaks at the bound
form a contour; of its points the one with the least integral of the error's magnitude is sought. That integral is of the exact linear
model's answer, by a Fourier series over a record, and only ranks: its error is told by the length and the number of its terms.

Source: Astrom, Panagopoulos and Hagglund (1998), Automatica 34(5), 585-601; the criteria: Astrom and Hagglund (2006), Advanced PID Control,
section 4.9.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.plants.loop_signals import LoopSignals
from revline.design.regions.gain_region import find_gain_region
from revline.design.regions.loop_family import family_of_system
from revline.design.regions.sensitivity_contour import SensitivityContour, find_sensitivity_contour
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.interconnection import select
from revline.lti.state_space import DelayStateSpace, position
from revline.system import Floats

Complexes = NDArray[np.complex128]

KD_SPAN, KD_SAMPLES, KD_ROUNDS = 30.0, 9, 2
"""Derivative gains are tried from kp^2/ki over the first to it times the first, so many, and so often about the best."""

CANDIDATES = 40
"""Points of a contour whose IAE is computed, and again about the best."""

RECORD, TERMS = 60.0, 4096
"""Length of the record in times of kp/ki and plant lags, and terms of its Fourier series."""


class TwoInputSignals(NamedTuple):
    """Names of the signals: both inputs, what is measured, its rate, what disturbs, and what the fast input acts on."""

    fast: str = "spark"
    slow: str = "throttle"
    measurement: str = "engine_speed"
    measurement_rate: str = "engine_acceleration"
    disturbance: str = "load_torque"
    quantity: str = "indicated_torque"


SPEED_BY_SPARK_AND_THROTTLE = TwoInputSignals()
"""Engine speed by the spark, at once, and by the throttle, for good."""


class OneInputGains(NamedTuple):
    """Gains of one input alone, per error, per its integral, and per rate of the measurement."""

    kp: float
    ki: float
    kd: float


def largest_integral(
    model: DelayStateSpace, wires: tuple[str, TwoInputSignals], peak: float, *, kd: float = 0.0, sign: float = 1.0
) -> tuple[float, float]:
    """Find the (kp, ki) of the largest ki at which the sensitivity of one input's loop has a peak: of the least integral of the error.

    Args:
        model: exact linear model.
        wires: the input, and the names of the signals.
        peak: Ms.
        kd: derivative gain.
        sign: of the input's gain; the gains are for an input turned so that it raises the measurement.

    Raises:
        AnalysisError: no gains have that peak.
        InvalidInputError: no gains stabilise, or there are no such signals.
    """
    contour = _contour(model, wires, peak, kd, sign)
    best = int(np.argmax(contour.ki))
    return float(contour.kp[best]), float(contour.ki[best])


def _contour(model: DelayStateSpace, wires: tuple[str, TwoInputSignals], peak: float, kd: float, sign: float) -> SensitivityContour:
    drive, signals = wires
    column = position(model.inputs, drive)
    rows = [position(model.outputs, name) for name in (signals.measurement, signals.measurement_rate)]
    one = select(model, [column], rows)
    turned = replace(one, Bu=sign * one.Bu, Dzu=sign * one.Dzu, Dyu=sign * one.Dyu)
    loop = LoopSignals(drive=drive, measurement=signals.measurement, measurement_rate=signals.measurement_rate)
    family = family_of_system(turned, kd=kd, wires=loop, name=f"{signals.measurement} by {drive}")
    contour = find_sensitivity_contour(find_gain_region(family), peak)
    if not contour.ki.size:
        message = f"no PI gains of {drive} have Ms = {peak:g} with kd = {kd:g}; allow a larger Ms"
        raise AnalysisError(message, peak=peak, kd=kd)
    return contour


def tune_one_input(model: DelayStateSpace, drive: str, signals: TwoInputSignals, *, ms: float) -> OneInputGains:
    """Find PID gains of one input with the least IAE after a step of the disturbance, among those whose Ms is the bound.

    Args:
        model: exact linear model.
        drive: the input.
        signals: names of the signals.
        ms: peak of the sensitivity.

    Raises:
        AnalysisError: no PI gains have that peak.
        InvalidInputError: no gains stabilise, or there are no such signals.
    """
    kp, ki = largest_integral(model, (drive, signals), ms)
    unit, span = kp * kp / ki, float(np.log(KD_SPAN))
    answer = _LoadAnswer.of(model, drive, signals, time=kp / ki + float(np.sum(model.lags)))
    best = _least(model, (drive, signals), ms, (0.0, answer))
    middle = 0.0
    for _ in range(KD_ROUNDS):
        for log_kd in middle + np.linspace(-span, span, KD_SAMPLES):
            try:
                found = _least(model, (drive, signals), ms, (unit * float(np.exp(log_kd)), answer))
            except (AnalysisError, InvalidInputError):  # too much derivative action: no gains are left
                continue
            if found[0] < best[0]:
                best, middle = found, float(log_kd)
        span *= 2.0 / (KD_SAMPLES - 1)
    return best[1]


def _least(
    model: DelayStateSpace, wires: tuple[str, TwoInputSignals], ms: float, trial: tuple[float, "_LoadAnswer"]
) -> tuple[float, OneInputGains]:
    """Of a contour's points the one with the least IAE, and that."""
    kd, answer = trial
    contour = _contour(model, wires, ms, kd, 1.0)
    coarse = np.unique(np.linspace(0, contour.ki.size - 1, CANDIDATES).astype(int))
    at = int(np.argmin(answer.integrated_errors(contour.kp[coarse], contour.ki[coarse], kd)))
    near = np.unique(np.linspace(coarse[max(at - 1, 0)], coarse[min(at + 1, coarse.size - 1)], CANDIDATES).astype(int))
    errors = answer.integrated_errors(contour.kp[near], contour.ki[near], kd)
    best = int(np.argmin(errors))
    return float(errors[best]), OneInputGains(float(contour.kp[near[best]]), float(contour.ki[near[best]]), kd)


class _LoadAnswer(NamedTuple):
    """Exact responses from the input and from the disturbance to the measurement, at the frequencies of a Fourier series."""

    s: Complexes
    by_drive: Complexes
    by_load: Complexes
    length: float

    @classmethod
    def of(cls, model: DelayStateSpace, drive: str, signals: TwoInputSignals, *, time: float) -> "_LoadAnswer":
        length = RECORD * time
        s = 2j * np.pi * np.arange(1, TERMS + 1) / length
        values = np.asarray(model.transfer(s)[:, position(model.outputs, signals.measurement)], dtype=np.complex128)
        columns = position(model.inputs, drive), position(model.inputs, signals.disturbance)
        return cls(np.asarray(s, dtype=np.complex128), values[:, columns[0]], values[:, columns[1]], length)

    def integrated_errors(self, kp: Floats, ki: Floats, kd: float) -> Floats:
        """IAE after a unit step of the disturbance, for some gains, shape (n,); what outlasts the record laps over."""
        law = kp[:, None] + ki[:, None] / self.s + kd * self.s
        answer = self.by_load / (1.0 + self.by_drive * law) / self.s
        series = np.fft.irfft(np.concatenate((np.zeros((kp.size, 1)), answer), axis=1), axis=1) * (2.0 * TERMS / self.length)
        series -= series[:, :1]  # the answer begins at zero, which gives the mean that the series lacks
        return np.asarray(np.sum(np.abs(series), axis=1) * self.length / series.shape[1])
