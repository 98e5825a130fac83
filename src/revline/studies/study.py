"""The whole study: from questions to results, one kept step after the other."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from revline.analysis.linearity import judge_linearity
from revline.analysis.spectrum import check_spectra
from revline.analysis.threads import Progress
from revline.errors import AnalysisError, InvalidInputError, PartialResultError
from revline.studies import loop_steps, routes, steps
from revline.studies.chain import Chain, Report
from revline.studies.config import StudyConfig
from revline.studies.delay_models import find_delay_models
from revline.studies.guidelines import write_guidelines
from revline.studies.hunting_steps import find_hunting
from revline.studies.model_distance import find_distances
from revline.studies.operating_map import find_map
from revline.studies.parts import Parts
from revline.studies.rivals import find_rivals
from revline.studies.stability_steps import find_stability
from revline.studies.study_results import StudyResults
from revline.studies.trials import try_controllers
from revline.studies.two_inputs import find_two_inputs
from revline.system import DelaySystem
from revline.values import fingerprint

NUMBERS_SHARE = 0.45
"""Part of a study's time that goes into its numbers; the rest is drawing and writing."""

GUIDELINES = "guidelines"


class Task(NamedTuple):
    """What every step may use besides the results that it needs."""

    engine: DelaySystem
    config: StudyConfig
    progress: Progress


class StudyStep(NamedTuple):
    """A step: its name, its field of `StudyResults`, the fields that it needs, how it is made of these, its part of the time."""

    name: str
    field: str
    needs: tuple[str, ...]
    make: Callable[..., object]
    share: float


STEPS = (
    StudyStep("operating-point", "point", (), lambda task: steps.find_point(task.engine, task.config), 0.02),
    StudyStep("steady-map", "range", (), lambda task: steps.find_range(task.engine, task.config), 0.18),
    StudyStep("throttle-steps", "steps", ("point",), lambda task, point: steps.run_steps(task.engine, point, task.config), 0.03),
    StudyStep("sinusoid", "sine", ("point",), lambda task, point: steps.run_sine(task.engine, point, task.config), 0.02),
    StudyStep(
        "frequency-response",
        "response",
        ("point",),
        lambda task, point: steps.find_response(task.engine, point, task.config, task.progress),
        0.25,
    ),
    StudyStep(
        "spectra",
        "spectra",
        ("point",),
        lambda task, point: check_spectra(
            task.engine, point.trim, steps.excitation(task.config), task.config.spectrum_frequencies, progress=task.progress
        ),
        0.25,
    ),
    StudyStep(
        "cross-check",
        "routes",
        ("point", "response"),
        lambda task, point, response: routes.check_routes(task.engine, point, response, task.progress),
        0.02,
    ),
    StudyStep("models", "models", ("response",), lambda _, response: steps.fit_models(response.response()), 0.05),
    StudyStep(
        "models-of-table",
        "table_models",
        (),
        lambda task: (steps.fit_models(steps.table_response()),) if task.config.is_the_thesis else (),
        0.05,
    ),
    StudyStep("controllers", "controllers", ("models",), lambda task, models: steps.design_controllers(models, task.config), 0.05),
    StudyStep(
        "closed-loops",
        "loops",
        ("point", "models", "controllers"),
        lambda task, point, models, controllers: loop_steps.run_loops(task.engine, point, models, controllers, task.config),
        0.05,
    ),
    StudyStep(
        "stability",
        "stability",
        ("point", "models", "controllers", "loops"),
        lambda task, *found: find_stability(task.engine, *found),
        0.02,
    ),
    StudyStep(
        "model-distance",
        "distance",
        ("point", "models", "controllers", "stability"),
        lambda task, *found: find_distances(task.engine, *found),
        0.02,
    ),
    StudyStep(
        "hunting",
        "hunting",
        ("point", "controllers", "loops"),
        lambda task, *found: find_hunting(task.engine, *found),
        0.04,
    ),
    StudyStep(
        "linear-range",
        "linear_range",
        ("point",),
        lambda task, point: steps.find_linear_range(task.engine, point, task.config, task.progress),
        0.01,
    ),
    StudyStep(
        "model-errors",
        "errors",
        ("point", "models"),
        lambda task, point, models: loop_steps.find_errors(task.engine, point, models, task.config),
        0.01,
    ),
    StudyStep(
        "delay-models",
        "delay_models",
        ("point", "models", "errors"),
        lambda task, point, models, errors: find_delay_models(point, models, errors, task.config.amplitude_deg),
        0.01,
    ),
    StudyStep(
        "rules-and-optimum",
        "rivals",
        ("point", "controllers"),
        lambda task, point, controllers: find_rivals(task.engine, point, controllers),
        0.05,
    ),
    StudyStep("operating-map", "operating_map", (), lambda task: find_map(task.engine, task.config, task.progress), 0.15),
    StudyStep(
        "acceptance",
        "trials",
        ("point", "controllers", "operating_map"),
        lambda task, *found: try_controllers(task.engine, *found, config=task.config, progress=task.progress),
        0.1,
    ),
    StudyStep("two-inputs", "two_inputs", (), lambda task: find_two_inputs(task.engine, task.config), 0.05),
)
"""All steps but the guidelines, which need every other."""


def compute_study(config: StudyConfig, folder: Path, report: Report, told: Callable[[Parts], None] = lambda _: None) -> StudyResults:
    """Compute all numbers of a study, or take those that are kept in its folder.

    A step that cannot be completed does not keep those from being computed that do not need it.

    Args:
        config: the questions.
        folder: where steps are kept.
        report: told the step under way and the part done.
        told: given what there is after each step.

    Raises:
        InvalidInputError: the engine or a question is unusable; nothing more is computed.
        PartialResultError: a step could not be completed; the message says which and why.
    """
    engine = config.load_engine()
    chain = Chain(folder=folder, origin=fingerprint(config, engine.content_digest), report=report)
    parts, begin = Parts(), 0.0
    for step in STEPS:
        share = (NUMBERS_SHARE * begin, NUMBERS_SHARE * (begin + step.share))
        task = Task(engine, config, _within(report, step.name, share))
        parts, begin = _take(chain, step, task, parts, share), begin + step.share
        told(parts)
    if not parts.is_whole:
        parts = parts.with_skipped(GUIDELINES, tuple(sorted({step.field for step in STEPS} - set(parts.found))))
        told(parts)
        message = f"the study {parts.text}; what is finished is kept in {folder}, which says that it is partial"
        raise PartialResultError(message)
    results = StudyResults(**parts.found, linearity=judge_linearity((parts.found["response"],), parts.found["spectra"]))
    guidelines = chain.step(GUIDELINES, lambda: write_guidelines(engine, results), results, share=(NUMBERS_SHARE * begin, NUMBERS_SHARE))
    told(parts.with_result(GUIDELINES, GUIDELINES, guidelines))
    return replace(results, guidelines=guidelines)


def _take(chain: Chain, step: StudyStep, task: Task, parts: Parts, share: tuple[float, float]) -> Parts:
    """Take or make one step, or note why it is not there."""
    wants = tuple(_wanting(step, parts))
    if wants:
        return parts.with_skipped(step.name, wants)
    needed = [parts.found[name] for name in step.needs]
    try:
        result: Any = chain.step(step.name, lambda: step.make(task, *needed), *needed, share=share)
    except AnalysisError as error:
        return parts.with_failure(step.name, str(error))
    except InvalidInputError as error:
        message = f"step {step.name} of the study: {error}"
        raise InvalidInputError(message, **error.details) from error
    return parts.with_result(step.name, step.field, result)


def _wanting(step: StudyStep, parts: Parts) -> Iterator[str]:
    names = {other.field: other.name for other in STEPS}
    yield from (names[field] for field in step.needs if field not in parts.found)


def _within(report: Report, name: str, share: tuple[float, float]) -> Progress:
    return lambda part: report(name, share[0] + part * (share[1] - share[0]))
