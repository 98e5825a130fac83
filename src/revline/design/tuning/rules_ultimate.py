"""Tuning rules that start from the ultimate gain and period, wherever these are from: the exact model, a relay, a bisection."""

from revline.design.controllers.pid_forms import IdealForm, ParallelForm
from revline.design.tuning.ultimate import UltimatePoint


def tune_p_ultimate(point: UltimatePoint) -> ParallelForm:
    """Tune a P controller: half the ultimate gain.

    Source:
        Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.
    """
    return ParallelForm(0.5 * point.gain, 0.0, 0.0)


def tune_pi_ultimate(point: UltimatePoint) -> ParallelForm:
    """Tune a PI controller: 0.45 of the ultimate gain, integral time the period over 1.2.

    Source:
        Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.
    """
    return IdealForm(gain=0.45 * point.gain, integral_time=point.period / 1.2).to_parallel()


def tune_pid_ultimate(point: UltimatePoint) -> ParallelForm:
    """Tune a PID controller: 0.6 of the ultimate gain, half and an eighth of the period.

    Source:
        Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.

    Example:
        >>> from revline.design.tuning.ultimate import UltimateSource
        >>> tune_pid_ultimate(UltimatePoint(gain=2.0, period=0.5, source=UltimateSource.GIVEN))
        ParallelForm(kp=1.2, ki=4.8, kd=0.075)
    """
    return IdealForm(gain=0.6 * point.gain, integral_time=0.5 * point.period, derivative_time=0.125 * point.period).to_parallel()


def tune_pi_tyreus_luyben(point: UltimatePoint) -> ParallelForm:
    """Tune a PI controller more mildly: the ultimate gain over 3.2, integral time 2.2 periods.

    Source:
        Tyreus and Luyben (1992), Industrial and Engineering Chemistry Research 31(11), 2625-2628.
    """
    return IdealForm(gain=point.gain / 3.2, integral_time=2.2 * point.period).to_parallel()


def tune_pid_tyreus_luyben(point: UltimatePoint) -> ParallelForm:
    """Tune a PID controller more mildly: the ultimate gain over 2.2, times of 2.2 periods and a period over 6.3.

    Source:
        Luyben (1996), Industrial and Engineering Chemistry Research 35(10), 3480-3483, after Tyreus and Luyben (1992).
    """
    return IdealForm(gain=point.gain / 2.2, integral_time=2.2 * point.period, derivative_time=point.period / 6.3).to_parallel()
