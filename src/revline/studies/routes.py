"""The study's cross-check: its frequency response by three independent routes, in results.json, in the checks, in a figure and in words."""

from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from revline.analysis.balance_attempts import PartialBalance, attempt_balance
from revline.analysis.cross_check import LARGE_SIGNAL, SETTINGS, SMALL_SIGNAL, CrossCheck, compare_routes
from revline.analysis.harmonic_balance import HarmonicBalance
from revline.analysis.routes import BALANCE, EXACT, ResponseDifference, RouteComparison
from revline.analysis.sinestream import Sinestream
from revline.analysis.threads import Progress
from revline.errors import AnalysisError
from revline.io.cross_check_records import cross_check_record
from revline.report.parts import Curve
from revline.report.style import MODELS, Quantity
from revline.studies.results import PointResult
from revline.system import DelaySystem, Floats

FIGURE = "4.15"
"""Number of the figure of the cross-check; the thesis's chapter on the frequency response ends with 4.14."""

ROUTE_ROW = MappingProxyType(
    {
        "id": FIGURE,
        "title": "Differences between the routes to the frequency response",
        "x": "frequency (rad/s)",
        "y": "difference, relative or in rad",
    }
)
"""As a row of the thesis's list of figures."""

SMALLEST = 1e-13
"""Differences below this are drawn there: a logarithmic axis has no zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoutesResult:
    """Harmonic balance at the study's amplitude, and what the routes say of each other.

    Attributes:
        balances: one, or none where there is no orbit at any frequency.
        check: the cross-check; its routes agree.
        effects: of the amplitude, the exact small-signal response against harmonic balance; one for each of these.
    """

    balances: tuple[HarmonicBalance, ...]
    check: CrossCheck
    effects: tuple[ResponseDifference, ...]


def check_routes(engine: DelaySystem, point: PointResult, stream: Sinestream, progress: Progress | None = None) -> RoutesResult:
    """Find the response by harmonic balance, and see that all routes agree.

    Args:
        engine: the study's.
        point: its operating point with the exact small-signal response.
        stream: the simulated response.
        progress: told which part of the harmonic balance is done.

    Raises:
        AnalysisError: two routes disagree; the message has the numbers.
    """
    found = _balance(engine, point, stream, progress)
    # Where frequencies are missing, the check finds out by itself why.
    whole = found[0] if found and found[0].omega.size == stream.omega.size else None
    check = compare_routes(engine, point.trim, stream.excitation, point.exact, balance=whole, stream=stream)
    check.require_agreement()
    effects = (
        ResponseDifference(
            routes=(EXACT, BALANCE),
            omega=balance.omega,
            first=point.exact.values[np.isin(point.exact.omega, balance.omega)],
            second=balance.fundamental.values,
        )
        for balance in found
    )
    return RoutesResult(balances=found, check=check, effects=tuple(effects))


def _balance(engine: DelaySystem, point: PointResult, stream: Sinestream, progress: Progress | None) -> tuple[HarmonicBalance, ...]:
    try:
        found = attempt_balance(engine, point.trim, stream.excitation, stream.omega, settings=SETTINGS, progress=progress)
    except AnalysisError:
        return ()
    return (found.finished if isinstance(found, PartialBalance) else found,)


def routes_fields(routes: RoutesResult) -> dict[str, Any]:
    """The field `cross_check` of results.json."""
    return dict(cross_check_record(routes.check, routes.effects[0] if routes.effects else None))


def balance_rows(routes: RoutesResult) -> list[dict[str, Any]]:
    """Rows of the frequency response by harmonic balance."""
    return [
        {
            "method": "harmonic-balance",
            "frequency_rad_s": float(balance.omega[k]),
            "amplitude_rad_s": float(balance.amplitude[k]),
            "phase_deg": float(balance.phase_deg[k]),
            "distortion": float(balance.distortion[k]),
            "mean_shift_rad_s": float(balance.mean_shift[k]),
            "estimated_error": float(balance.error[k] + balance.last_step[k]),
        }
        for balance in routes.balances
        for k in range(balance.omega.size)
    ]


def route_measures(routes: RoutesResult) -> Iterator[tuple[str, float, float, float]]:
    """Checks: name, measured, expected, tolerance."""
    for comparison in routes.check.comparisons:
        name = " against ".join(comparison.difference.routes)
        yield f"{name}: largest part of the tolerance", float(comparison.used.max()), 0.0, 1.0


def route_warnings(routes: RoutesResult) -> Iterator[str]:
    """What could not be compared, and what is less certain than asked for."""
    yield from (str(left) for left in routes.check.unchecked)
    for balance in routes.balances:
        yield from balance.fundamental.notes
        rough = balance.error > SETTINGS.tolerance
        if np.any(rough):
            k = int(np.argmax(balance.error))
            yield (
                f"harmonic balance is rough at {int(np.sum(rough))} of {rough.size} frequencies, as where an orbit crosses a limit: the "
                f"fundamental is known to {float(balance.error[k]):.1g} of itself at worst, at {balance.omega[k]:g} rad/s"
            )


def route_curves(routes: RoutesResult) -> tuple[Curve, ...]:
    """Differences between the routes over frequency, with their tolerances, and the effect of the amplitude."""
    curves = [Curve(x=d.omega, y=_size(d), label="exact, from harmonic balance at this amplitude", look=MODELS[2]) for d in routes.effects]
    for routes_named, look, label in (
        (LARGE_SIGNAL, 1, "harmonic balance from simulation"),
        (SMALL_SIGNAL, 0, "exact from vanishing amplitude"),
    ):
        for comparison in _compared(routes, routes_named):
            omega = comparison.difference.omega
            curves.append(Curve(x=omega, y=_size(comparison.difference), label=label, look=MODELS[look]._replace(dash="-")))
            curves.append(
                Curve(x=omega, y=comparison.tolerance, label=f"allowed, {label}", look=MODELS[look]._replace(dash=":", width=1.0))
            )
    return tuple(curves)


ROUTE_AXES = (Quantity("frequency", "rad/s"), Quantity("difference, relative or in rad", "1"))
"""What the figure's axes show."""


def route_caption(routes: RoutesResult) -> str:
    """What to see in the figure."""
    text = "The larger of the relative difference of the magnitude and that of the phase in radians; dotted: what is allowed."
    parts = [
        f"{c.difference.routes[0]} and {c.difference.routes[1]} take at most {100.0 * float(c.used.max()):.2g} % of it"
        for c in routes.check.comparisons
    ]
    return f"{text} {'; '.join(part[0].upper() + part[1:] for part in parts[:1])}{''.join(f'; {part}' for part in parts[1:])}."


def route_words(routes: RoutesResult) -> str:
    """What the report says of the routes, and of the effect of the amplitude."""
    text = (
        "Three routes that have nothing but the equations and the steady state in common check each other. Harmonic balance solves "
        "the nonlinear equations on whole orbits, without simulating: at vanishing amplitude it must be the exact small-signal "
        "response, and at the study's amplitude what the simulated sinusoids settle at. "
        f"[](#figure-{FIGURE}) shows how far they are apart, and what their own error estimates allow."
    )
    for effect in routes.effects:
        k, j = int(np.argmax(np.abs(effect.magnitude))), int(np.argmax(np.abs(effect.phase_deg)))
        sizes = f"{100.0 * effect.magnitude[k]:+.2g} % at {effect.omega[k]:g} rad/s and {effect.phase_deg[j]:+.2g} deg"
        text += (
            f" What is left between the exact response and the others is the effect of the amplitude: {sizes} at "
            f"{effect.omega[j]:g} rad/s, where they are largest."
        )
    return text


def _compared(routes: RoutesResult, named: tuple[str, str]) -> list[RouteComparison]:
    return [comparison for comparison in routes.check.comparisons if comparison.difference.routes == named]


def _size(difference: ResponseDifference) -> Floats:
    larger: Floats = np.maximum(np.abs(difference.magnitude), np.radians(np.abs(difference.phase_deg)))
    return np.maximum(larger, SMALLEST)
