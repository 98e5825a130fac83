"""The whole study: from questions to results, one kept step after the other."""

import itertools
from dataclasses import replace
from pathlib import Path

from revline.analysis.linearity import judge_linearity
from revline.analysis.spectrum import check_spectra
from revline.analysis.threads import Progress
from revline.studies import loop_steps, steps
from revline.studies.chain import Chain, Report
from revline.studies.config import StudyConfig
from revline.studies.guidelines import write_guidelines
from revline.studies.study_results import StudyResults
from revline.values import fingerprint

NUMBERS_SHARE = 0.45
"""Part of a study's time that goes into its numbers; the rest is drawing and writing."""


def compute_study(config: StudyConfig, folder: Path, report: Report) -> StudyResults:
    """Compute all numbers of a study, or take those that are kept in its folder.

    Args:
        config: the questions.
        folder: where steps are kept.
        report: told the step under way and the part done.

    Raises:
        InvalidInputError: the engine or a question is unusable.
        AnalysisError: a step could not be completed; finished ones are kept.
    """
    engine = config.load_engine()
    chain = Chain(folder=folder, origin=fingerprint(config, engine.content_digest), report=report)
    ends = [NUMBERS_SHARE * part for part in (0.0, 0.02, 0.2, 0.23, 0.25, 0.5, 0.75, 0.8, 0.85, 0.9, 0.95, 0.98, 1.0)]
    shares = itertools.pairwise(ends)

    def within(share: tuple[float, float], name: str) -> Progress:
        return lambda part: report(name, share[0] + part * (share[1] - share[0]))

    point = chain.step("operating-point", lambda: steps.find_point(engine, config), share=next(shares))
    found_range = chain.step("steady-map", lambda: steps.find_range(engine, config), share=next(shares))
    stepped = chain.step("throttle-steps", lambda: steps.run_steps(engine, point, config), point, share=next(shares))
    sine = chain.step("sinusoid", lambda: steps.run_sine(engine, point, config), point, share=next(shares))
    share = next(shares)
    response = chain.step(
        "frequency-response", lambda: steps.find_response(engine, point, config, within(share, "frequency-response")), point, share=share
    )
    share = next(shares)
    spectra = chain.step(
        "spectra",
        lambda: check_spectra(engine, point.trim, steps.excitation(config), config.spectrum_frequencies, progress=within(share, "spectra")),
        point,
        share=share,
    )
    models = chain.step("models", lambda: steps.fit_models(response.response()), response, share=next(shares))
    table_models = chain.step(
        "models-of-table", lambda: (steps.fit_models(steps.table_response()),) if config.is_the_thesis else (), share=next(shares)
    )
    controllers = chain.step("controllers", lambda: steps.design_controllers(models, config), models, share=next(shares))
    loops = chain.step(
        "closed-loops",
        lambda: loop_steps.run_loops(engine, point, models, controllers, config),
        point, models, controllers, share=next(shares),
    )  # fmt: skip
    errors = chain.step("model-errors", lambda: loop_steps.find_errors(engine, point, models, config), point, models, share=next(shares))
    results = StudyResults(
        point=point,
        range=found_range,
        steps=stepped,
        spectra=spectra,
        linearity=judge_linearity((response,), spectra),
        sine=sine,
        response=response,
        models=models,
        table_models=table_models,
        controllers=controllers,
        loops=loops,
        errors=errors,
    )
    guidelines = chain.step("guidelines", lambda: write_guidelines(engine, results), results, share=next(shares))
    return replace(results, guidelines=guidelines)
