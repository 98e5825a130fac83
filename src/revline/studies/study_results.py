"""All results of a study together."""

from dataclasses import dataclass

from revline.analysis.linear_range import LinearRanges
from revline.analysis.linearity import LinearityVerdict
from revline.analysis.sinestream import Sinestream
from revline.analysis.spectrum import SpectralCheck
from revline.studies.delay_models import DelayModels
from revline.studies.hunting_results import HuntingResult
from revline.studies.model_distance import DistanceResult
from revline.studies.operating_map import MapResult
from revline.studies.results import (
    ControllersResult,
    ErrorsResult,
    LoopsResult,
    ModelsResult,
    PointResult,
    RangeResult,
    SineRecord,
    StepsResult,
)
from revline.studies.rivals import RivalsResult
from revline.studies.routes import RoutesResult
from revline.studies.stability_results import StabilityResult
from revline.studies.trials import TrialsResult
from revline.studies.two_inputs import TwoInputsResult


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StudyResults:
    """Results of all steps; `table_models` has the models of Lee's Table 4.1 where the study is about it, else nothing."""

    point: PointResult
    range: RangeResult
    steps: StepsResult
    spectra: tuple[SpectralCheck, ...]
    linearity: LinearityVerdict
    sine: SineRecord
    response: Sinestream
    routes: RoutesResult
    models: ModelsResult
    table_models: tuple[ModelsResult, ...]
    controllers: ControllersResult
    loops: LoopsResult
    stability: StabilityResult
    distance: DistanceResult
    hunting: HuntingResult
    linear_range: LinearRanges
    errors: ErrorsResult
    delay_models: DelayModels
    rivals: RivalsResult
    operating_map: MapResult
    trials: TrialsResult
    two_inputs: TwoInputsResult
    guidelines: tuple[str, ...] = ()
