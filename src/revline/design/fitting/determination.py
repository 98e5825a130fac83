"""Tell whether the data determine a fitted model: from the condition of its least squares and the uncertainty of its coefficients."""

from collections.abc import Iterator
from typing import Final

from scipy.special import stdtrit

from revline.design.fitting.fit import ModelFit

COLLINEAR: Final = 30.0
"""From this condition number on, the Jacobian's columns scaled to one length, some parameters stand for each other."""

CONFIDENCE: Final = 0.95
"""Of the intervals in which a coefficient lies."""


def find_undetermined(fit: ModelFit) -> tuple[str, ...]:
    """Give the reasons why the data do not determine a model; none where they do.

    Parameters that stand for each other are told by the condition number. A gain, or a denominator's last coefficient, that may as well be
    0 is told by Student's t for as many spare numbers as there are: two for each frequency, less the parameters. Under the phase-line
    rule both are of the model without delay. Data with fewer numbers than parameters are refused by the fit itself.

    Args:
        fit: the model with its data.

    Returns:
        Each reason with its numbers and limits.

    Source:
        Belsley, Kuh and Welsch (1980), Regression Diagnostics, section 3.2 (condition indexes of 30 and more); Pintelon and Schoukens
        (2012), System Identification, section 9.2 (covariance).
    """
    return tuple(_reasons(fit))


def _reasons(fit: ModelFit) -> Iterator[str]:
    optimum = fit.optimum
    if optimum.condition >= COLLINEAR:
        yield f"its parameters stand for each other (condition number {optimum.condition:.3g}, limit {COLLINEAR:g})"
    spare = 2 * fit.data.omega.size - int(fit.data.omega[0] == 0.0) - optimum.covariance.shape[0]
    times = float(stdtrit(spare, 0.5 * (1.0 + CONFIDENCE)))
    parts = [("gain", optimum.numerator[0], fit.numerator_deviation[0])]
    if len(optimum.denominator) > 1:
        parts.append(("denominator's last coefficient", optimum.denominator[-1], fit.denominator_deviation[-1]))
    for name, value, deviation in parts:
        if times * deviation >= abs(value):
            yield f"its {name} may as well be 0 ({value:.3g} +- {times * deviation:.2g} at {100 * CONFIDENCE:g} %; spare numbers: {spare})"
