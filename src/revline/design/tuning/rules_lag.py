"""Tuning rules that start from a lag with delay, K exp(-L s)/(T s + 1).

Each rule is a function of the lag, its range and its source in its docstring; the table is in `revline.design.tuning.rules`.
"""

import math
from typing import NamedTuple

from revline.design.controllers.pid_forms import IdealForm, ParallelForm, SeriesForm
from revline.errors import InvalidInputError, out_of_range
from revline.units import Dimensionless, Seconds


class Lag(NamedTuple):
    """Static gain, lag and delay of K exp(-L s)/(T s + 1)."""

    gain: float
    lag: Seconds
    delay: Seconds


class Weighted(NamedTuple):
    """Gains, and the set-point weight that the rule recommends with them."""

    gains: ParallelForm
    setpoint_weight: Dimensionless


LARGEST_RATIO = 1.0
"""Cohen-Coon and Ziegler-Nichols are for delays up to the lag."""


def tune_p_ziegler_nichols(plant: Lag) -> ParallelForm:
    """Tune a P controller from a step response: kp = T/(K L).

    Raises:
        InvalidInputError: the delay is not positive or above the lag.

    Source:
        Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.
    """
    require_short_delay(plant, "ziegler-nichols-p")
    return ParallelForm(plant.lag / (plant.gain * plant.delay), 0.0, 0.0)


def tune_pi_ziegler_nichols(plant: Lag) -> ParallelForm:
    """Tune a PI controller from a step response: kp = 0.9 T/(K L), integral time L/0.3.

    Raises:
        InvalidInputError: the delay is not positive or above the lag.

    Source:
        Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.
    """
    require_short_delay(plant, "ziegler-nichols-pi")
    return IdealForm(gain=0.9 * plant.lag / (plant.gain * plant.delay), integral_time=plant.delay / 0.3).to_parallel()


def tune_pi_cohen_coon(plant: Lag) -> ParallelForm:
    """Tune a PI controller for a quarter decay.

    With r = L/T: K kp = (0.9 + r/12)/r, integral time L (30 + 3 r)/(9 + 20 r).

    Raises:
        InvalidInputError: the delay is not positive or above the lag.

    Source:
        Cohen and Coon (1953), Transactions of the ASME 75, 827-834.
    """
    ratio = require_short_delay(plant, "cohen-coon-pi")
    gain = (0.9 + ratio / 12.0) / (ratio * plant.gain)
    return IdealForm(gain=gain, integral_time=plant.delay * (30.0 + 3.0 * ratio) / (9.0 + 20.0 * ratio)).to_parallel()


def tune_pid_cohen_coon(plant: Lag) -> ParallelForm:
    """Tune a PID controller for a quarter decay.

    With r = L/T: K kp = (4/3 + r/4)/r, integral time L (32 + 6 r)/(13 + 8 r), derivative time 4 L/(11 + 2 r).

    Raises:
        InvalidInputError: the delay is not positive or above the lag.

    Source:
        Cohen and Coon (1953), Transactions of the ASME 75, 827-834.
    """
    ratio = require_short_delay(plant, "cohen-coon")
    return IdealForm(
        gain=(4.0 / 3.0 + ratio / 4.0) / (ratio * plant.gain),
        integral_time=plant.delay * (32.0 + 6.0 * ratio) / (13.0 + 8.0 * ratio),
        derivative_time=4.0 * plant.delay / (11.0 + 2.0 * ratio),
    ).to_parallel()


def tune_pi_simc(plant: Lag, *, closed_loop_lag: Seconds) -> ParallelForm:
    """Tune a PI controller for a wanted closed-loop lag Tc: kp = T/(K (Tc + L)), integral time min(T, 4 (Tc + L)).

    Args:
        plant: lag with delay, for example from the half rule.
        closed_loop_lag: Tc; the delay is fast and still robust, more is smoother.

    Raises:
        InvalidInputError: Tc is not positive.

    Source:
        Skogestad (2003), Journal of Process Control 13(4), 291-309.

    Example:
        >>> tune_pi_simc(Lag(gain=2.0, lag=0.8, delay=0.1), closed_loop_lag=0.1)
        ParallelForm(kp=2.0, ki=2.5, kd=0.0)
    """
    _require_lag(plant, closed_loop_lag)
    gain, integral = _simc(plant, closed_loop_lag)
    return IdealForm(gain=gain, integral_time=integral).to_parallel()


def tune_pid_simc(plant: Lag, second_lag: Seconds, *, closed_loop_lag: Seconds) -> ParallelForm:
    """Tune a PID controller of series form, whose derivative cancels the second lag.

    Args:
        plant: first lag with delay.
        second_lag: not above the first.
        closed_loop_lag: as for `tune_pi_simc`.

    Raises:
        InvalidInputError: a lag is out of range.

    Source:
        Skogestad (2003), Journal of Process Control 13(4), 291-309.
    """
    _require_lag(plant, closed_loop_lag)
    if not 0.0 < second_lag <= plant.lag:
        limit = f"above 0 to the first lag, {plant.lag:g} s"
        raise out_of_range("second lag", second_lag, "s", limit, "use simc-pi for a plant of one lag")
    gain, integral = _simc(plant, closed_loop_lag)
    return SeriesForm(gain=gain, integral_time=integral, derivative_time=second_lag).to_parallel()


def tune_pi_amigo(plant: Lag) -> Weighted:
    """Tune a PI controller for a maximum sensitivity near 1.4.

    K kp = 0.15 + (0.35 - L T/(L + T)^2) T/L, integral time 0.35 L + 13 L T^2/(T^2 + 12 L T + 7 L^2).

    Raises:
        InvalidInputError: the delay is not positive.

    Source:
        Astrom and Hagglund (2006), Advanced PID Control, section 7.4.
    """
    _require_positive_delay(plant, "amigo-pi")
    lag, delay = plant.lag, plant.delay
    gain = (0.15 + (0.35 - lag * delay / (lag + delay) ** 2) * lag / delay) / plant.gain
    integral = 0.35 * delay + 13.0 * delay * lag**2 / (lag**2 + 12.0 * delay * lag + 7.0 * delay**2)
    return Weighted(IdealForm(gain=gain, integral_time=integral).to_parallel(), 1.0)


def tune_pid_amigo(plant: Lag) -> Weighted:
    """Tune a PID controller for a maximum sensitivity near 1.4; the set-point weight is 0 where the lag dominates, else 1.

    K kp = 0.2 + 0.45 T/L, integral time L (0.4 L + 0.8 T)/(L + 0.1 T), derivative time 0.5 L T/(0.3 L + T).

    Raises:
        InvalidInputError: the delay is not positive.

    Source:
        Astrom and Hagglund (2006), Advanced PID Control, section 7.5.
    """
    _require_positive_delay(plant, "amigo")
    lag, delay = plant.lag, plant.delay
    form = IdealForm(
        gain=(0.2 + 0.45 * lag / delay) / plant.gain,
        integral_time=(0.4 * delay + 0.8 * lag) / (delay + 0.1 * lag) * delay,
        derivative_time=0.5 * delay * lag / (0.3 * delay + lag),
    )
    return Weighted(form.to_parallel(), 0.0 if delay / (delay + lag) <= 0.5 else 1.0)


def tune_pi_lambda(plant: Lag, *, closed_loop_lag: Seconds) -> ParallelForm:
    """Tune a PI controller that cancels the lag: kp = T/(K (L + Tc)), integral time T.

    Args:
        plant: lag with delay.
        closed_loop_lag: Tc wanted in closed loop, usually the plant's lag or a multiple.

    Raises:
        InvalidInputError: Tc is not positive.

    Source:
        Dahlin (1968), Instruments and Control Systems 41(6), 77-83; Astrom and Hagglund (2006), section 6.5.
    """
    _require_lag(plant, closed_loop_lag)
    gain = plant.lag / (plant.gain * (plant.delay + closed_loop_lag))
    return IdealForm(gain=gain, integral_time=plant.lag).to_parallel()


def _simc(plant: Lag, closed_loop_lag: float) -> tuple[float, float]:
    span = closed_loop_lag + plant.delay
    return plant.lag / (plant.gain * span), min(plant.lag, 4.0 * span)


def _require_lag(plant: Lag, closed_loop_lag: float) -> None:
    if not (math.isfinite(closed_loop_lag) and closed_loop_lag > 0.0):
        usual = f"the delay, {plant.delay:g} s, is usual" if plant.delay > 0.0 else "this plant has no delay to take for it; give one"
        raise out_of_range("closed-loop lag", closed_loop_lag, "s", "the positive numbers", usual)


def _require_positive_delay(plant: Lag, rule: str) -> None:
    if not plant.delay > 0.0:
        message = f"{rule} needs a delay; the plant's is {plant.delay:g} s, and the gains would be infinite; use pole placement or lambda"
        raise InvalidInputError(message, delay=plant.delay)


def require_short_delay(plant: Lag, rule: str) -> float:
    """Give delay over lag, for rules that were made for delays up to the lag.

    Raises:
        InvalidInputError: the delay is not positive or above the lag.
    """
    _require_positive_delay(plant, rule)
    ratio = plant.delay / plant.lag
    if not ratio <= LARGEST_RATIO:
        remedy = f"{rule} was made for delays up to the lag; use simc or amigo"
        raise out_of_range("delay over lag", ratio, "", f"0 to {LARGEST_RATIO:g}", remedy)
    return ratio
