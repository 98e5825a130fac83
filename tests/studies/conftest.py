"""One computed study for all tests of the study."""

from pathlib import Path

import pytest

from revline.studies.config import StudyConfig
from revline.studies.study import compute_study
from revline.studies.study_results import StudyResults


@pytest.fixture(scope="session")
def config() -> StudyConfig:
    return StudyConfig()


@pytest.fixture(scope="session")
def study_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="session")
def results(config: StudyConfig, study_folder: Path) -> StudyResults:
    return compute_study(config, study_folder, lambda _, __: None)
