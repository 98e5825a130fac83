"""Study files are read with their defaults, and every question out of range is refused by name."""

from pathlib import Path

import pytest

from revline.errors import InvalidInputError
from revline.studies.config import StudyConfig, read_config

PAGE = Path(__file__).parents[2] / "docs" / "study-files.md"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(text)
    return path


def test_the_file_on_the_page_asks_what_the_thesis_asked(tmp_path: Path) -> None:
    text = PAGE.read_text().partition("```toml\n")[2].partition("```")[0]
    assert read_config(written(tmp_path, text)) == StudyConfig()


def test_another_question_at_the_same_point_is_not_checked_against_the_thesis() -> None:
    other = StudyConfig(frequencies=tuple(float(k) for k in range(1, 10)))
    assert other.is_the_thesis
    assert not other.asks_what_the_thesis_asked
    assert StudyConfig().asks_what_the_thesis_asked


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("throttle_deg = 95.0", "study.throttle_deg = 95 deg"),
        ("half_range_deg = 30.0", r"half_range_deg = 30 deg about 25 deg reaches outside 0 to 90 deg; make it smaller"),
        ("overshoot_limit = 1.0", "study.overshoot_limit"),
        ("frequencies_rad_s = [1.0, 2.0]", "at least 8 rising frequencies"),
        ("frequencies_rad_s = [0, 1, 2, 3, 4, 5, 6, 7, 8]", "at least 8 rising frequencies"),
        ("spectrum_frequencies_rad_s = [1.0]", r"must be 6 rising frequencies above 0 rad/s, one for each of Figs 4\.4 to 4\.9"),
        ("spectrum_frequencies_rad_s = [6, 5, 4, 3, 2, 1]", "must be 6 rising"),
        ("steps_deg = []", "one or more throttle steps other than 0"),
        ("steps_deg = [5.0, 0.0]", "one or more throttle steps other than 0"),
        ("steps_deg = [true]", "no list of finite numbers"),
        ('throttle_deg = "wide"', "throttle_deg"),
        ("trottle_deg = 20.0", "trottle_deg"),
    ],
)
def test_a_question_without_sense_is_refused(line: str, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, f'schema = "revline.study-file/1"\n[study]\n{line}\n')
    with pytest.raises(InvalidInputError, match=message):
        read_config(path)


def test_an_engine_file_is_found_beside_the_study_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("")
    path = written(tmp_path, 'schema = "revline.study-file/1"\n[study]\nengine = "mine.toml"\n')
    assert read_config(path).engine == str(tmp_path / "mine.toml")
