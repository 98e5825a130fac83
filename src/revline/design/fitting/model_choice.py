"""Choose among fitted models: the structures that Lee (1995) compares, and a verdict with its reasons in numbers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from revline.design.fitting.fit import DelayRule, ModelFit, Weight, fit_transfer_function
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.response import Floats, FrequencyResponse

CANCELLING = 0.05
"""A zero this near to a pole, relative to its size, nearly cancels it: together they move the response by no more."""

UNSEEN = 100.0
"""A pole so many times the data's highest frequency is 0.6 deg of phase there: the data do not show where it is."""

AT_ORIGIN = 1e-6
"""A root this small against the data's lowest frequency lies at the origin, as far as the data can tell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelStructure:
    """What is fitted: a name, the degrees of numerator and denominator, and the rule for the delay."""

    name: str
    zeros: int
    poles: int
    delay: DelayRule = DelayRule.NONE


MODEL_STRUCTURES = (
    ModelStructure(name="g1", zeros=0, poles=1),
    ModelStructure(name="g2", zeros=0, poles=2),
    ModelStructure(name="g12", zeros=1, poles=2),
    ModelStructure(name="g2d", zeros=0, poles=2, delay=DelayRule.PHASE_LINE),
    ModelStructure(name="g3", zeros=0, poles=3),
    ModelStructure(name="g4", zeros=0, poles=4),
)
"""The six models of Lee (1995), Table 4.2."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedFit:
    """A fitted model with its structure."""

    structure: ModelStructure
    fit: ModelFit

    @property
    def name(self) -> str:
        """The structure's name."""
        return self.structure.name


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """Whether a model is fit for design, and why.

    Attributes:
        accepted: whether there is no objection.
        objections: each with its numbers and limits; none for an accepted model.
        text: the verdict in a sentence or two.
        numbers: what was judged, by name.
    """

    accepted: bool
    objections: tuple[str, ...]
    text: str
    numbers: Mapping[str, float]

    def __post_init__(self) -> None:
        if self.accepted == bool(self.objections):
            message = f"a verdict of accepted = {self.accepted} contradicts its {len(self.objections)} objections"
            raise InvalidInputError(message)
        object.__setattr__(self, "numbers", MappingProxyType(dict(self.numbers)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelChoice:
    """The model chosen, and the verdicts on all, in the order of the fits."""

    chosen: NamedFit
    verdicts: tuple[Verdict, ...]


def fit_structure(response: FrequencyResponse, structure: ModelStructure, *, weight: Weight = Weight.NONE) -> NamedFit:
    """Fit one structure; see `fit_transfer_function` for the method and what it raises."""
    fit = fit_transfer_function(response, zeros=structure.zeros, poles=structure.poles, delay=structure.delay, weight=weight)
    return NamedFit(structure=structure, fit=fit)


def fit_all_models(
    response: FrequencyResponse, *, structures: Sequence[ModelStructure] = MODEL_STRUCTURES, weight: Weight = Weight.NONE
) -> tuple[NamedFit, ...]:
    """Fit all structures to one response.

    Args:
        response: the data.
        structures: what to fit, by default the thesis's six.
        weight: how much each frequency counts.

    Raises:
        InvalidInputError, AnalysisError: as `fit_transfer_function`, for the first structure that cannot be fitted.

    Source:
        Lee (1995), section 4.3, Table 4.2.
    """
    return tuple(fit_structure(response, structure, weight=weight) for structure in structures)


def judge_model(fit: ModelFit, *, dominance_ratio: float = 9.0, magnitude_limit_db: float = 6.0, phase_limit_deg: float = 30.0) -> Verdict:
    """Judge a fitted model: stable, no zero in the right half plane, no needless pole, and close to the data throughout.

    Args:
        fit: the model with its data.
        dominance_ratio: in a model without delay, a pole at least so many times as fast as the slowest one counts as a stand-in for
            a delay; "about ten times" in the source. A model with its delay has no use for stand-ins, and its fast poles are the plant's.
        magnitude_limit_db: largest magnitude error.
        phase_limit_deg: largest phase error.

    Returns:
        The verdict with the numbers that it rests on.

    Raises:
        InvalidInputError: a limit is not positive.

    Source:
        Lee (1995), sections 4.3, 4.4 and 6.1, Table 6.1.
    """
    for name, limit in (
        ("dominance_ratio", dominance_ratio),
        ("magnitude_limit_db", magnitude_limit_db),
        ("phase_limit_deg", phase_limit_deg),
    ):
        if not limit > 0.0:
            message = f"{name} = {limit:g} is not positive; give a limit above 0"
            raise InvalidInputError(message)
    usable = _usable_frequency(fit, magnitude_limit_db, phase_limit_deg)
    ratios = pole_ratios(fit)
    objections = (
        *_half_plane_objections(fit),
        *_needless_objections(fit),
        *(_pole_objections(ratios, dominance_ratio) if fit.model.delay == 0.0 else ()),
        *_error_objections(fit, magnitude_limit_db, phase_limit_deg, usable),
    )
    numbers = {
        "max_magnitude_error_db": fit.max_magnitude_error_db,
        "max_phase_error_deg": fit.max_phase_error_deg,
        "usable_to_rad_s": usable,
        "fastest_pole_ratio": float(ratios.max(initial=1.0)),
        "delay_s": fit.model.delay,
        "residual_sum": fit.residual_sum,
    }
    text = "rejected: " + "; ".join(objections) if objections else _praise(fit, float(ratios.max(initial=1.0)), dominance_ratio)
    return Verdict(accepted=not objections, objections=objections, text=text, numbers=numbers)


def pole_ratios(fit: ModelFit) -> Floats:
    """How many times as fast as the slowest pole each other one is; a conjugate pair counts once.

    Returns:
        Ratios of magnitudes, rising; none for a model with fewer than two poles.
    """
    poles = fit.model.poles
    sizes = np.abs(poles[poles.imag >= 0.0])
    return sizes[1:] / sizes[0] if sizes.size and sizes[0] > 0.0 else np.zeros(0)


def choose_model(fits: Sequence[NamedFit]) -> ModelChoice:
    """Judge fitted models with the default limits and choose the accepted one with fewest poles, then with the smallest residual.

    Raises:
        AnalysisError: none is accepted; the message has every verdict.

    Source:
        Lee (1995), sections 4.4 and 6.1.
    """
    verdicts = tuple(judge_model(named.fit) for named in fits)
    accepted = [named for named, verdict in zip(fits, verdicts, strict=True) if verdict.accepted]
    if not accepted:
        reasons = "; ".join(f"{named.name} {verdict.text}" for named, verdict in zip(fits, verdicts, strict=True))
        message = f"no fitted model is accepted ({reasons}); fit other structures, or judge them with other limits"
        raise AnalysisError(message)
    chosen = min(accepted, key=lambda named: (named.structure.poles, named.fit.residual_sum))
    return ModelChoice(chosen=chosen, verdicts=verdicts)


def _half_plane_objections(fit: ModelFit) -> Iterator[str]:
    for pole in fit.model.poles:
        if pole.real >= 0.0 and pole.imag >= 0.0:
            yield f"the pole at s = {_show(pole)} 1/s is not in the left half plane, so that the model is unstable"
    origin = AT_ORIGIN * float(fit.data.omega[0])
    for zero in fit.model.zeros:
        if zero.real > origin and zero.imag >= 0.0:
            alone = zero.imag == 0.0 and not _cancels(fit, zero)
            stand_in = f", where a delay of about {2.0 / zero.real:.4f} s would say the same" if alone else ""
            yield f"the zero at s = {_show(zero)} 1/s lies in the right half plane and limits any controller{stand_in}"


def _needless_objections(fit: ModelFit) -> Iterator[str]:
    """Name poles that the data do not need: those nearly cancelled by a zero, and those far beyond the data's frequencies."""
    highest = float(fit.data.omega[-1])
    for pole in fit.model.poles[fit.model.poles.imag >= 0.0]:
        if _cancels(fit, pole):
            yield f"the pole at s = {_show(pole)} 1/s is nearly cancelled by a zero; fit one zero and one pole less for each such pole"
        elif abs(pole) > UNSEEN * highest:
            yield f"the pole at s = {_show(pole)} 1/s lies far beyond the data, which end at {highest:g} rad/s; fit fewer poles"


def _cancels(fit: ModelFit, root: complex) -> bool:
    """Whether a pole, or a zero, has one of the other kind close by."""
    near = [np.any(np.abs(roots - root) <= CANCELLING * abs(root)) for roots in (fit.model.poles, fit.model.zeros)]
    return bool(all(near))


def _pole_objections(ratios: Floats, limit: float) -> Iterator[str]:
    needless = ratios[ratios >= limit]
    if needless.size:
        yield (
            f"poles {' and '.join(f'{ratio:.1f}' for ratio in needless)} times as fast as the slowest one"
            f" (limit {limit:g}) add little but phase lag, which is a delay's"
        )


def _error_objections(fit: ModelFit, magnitude_limit: float, phase_limit: float, usable: float) -> Iterator[str]:
    inside = f"inside both limits up to {usable:g} rad/s" if usable > 0.0 else "outside the limits from the lowest frequency on"
    errors = (
        ("magnitude", fit.magnitude_error_db, magnitude_limit, "dB"),
        ("phase", fit.phase_error_deg, phase_limit, "deg"),
    )
    for name, error, limit, unit in errors:
        worst = int(np.argmax(np.abs(error)))
        if abs(error[worst]) > limit:
            where = f"at {fit.data.omega[worst]:g} rad/s"
            yield f"the {name} error reaches {error[worst]:.1f} {unit} {where} (limit {limit:g} {unit}; {inside})"


def _usable_frequency(fit: ModelFit, magnitude_limit: float, phase_limit: float) -> float:
    """Highest frequency of the data up to which both errors stay inside their limits; 0 where the first is outside."""
    outside = np.flatnonzero((np.abs(fit.magnitude_error_db) > magnitude_limit) | (np.abs(fit.phase_error_deg) > phase_limit))
    count = int(outside[0]) if outside.size else fit.data.omega.size
    return float(fit.data.omega[count - 1]) if count else 0.0


def _praise(fit: ModelFit, fastest: float, dominance_ratio: float) -> str:
    delay = f", with a delay of {fit.model.delay:.4f} s" if fit.model.delay > 0.0 else ""
    limit = f" (limit {dominance_ratio:g})" if fit.model.delay == 0.0 or fastest < dominance_ratio else ""
    poles = f" poles at most {fastest:.1f} times as fast as the slowest one{limit}," if fit.model.order > 1 else ""
    return (
        f"accepted{delay}: stable, no zero in the right half plane,{poles}"
        f" magnitude within {fit.max_magnitude_error_db:.1f} dB and phase within"
        f" {fit.max_phase_error_deg:.1f} deg of the data up to {fit.data.omega[-1]:g} rad/s"
    )


def _show(root: complex) -> str:
    return f"{root.real:.4g}" if root.imag == 0.0 else f"{root.real:.4g} +- {abs(root.imag):.4g}j"
