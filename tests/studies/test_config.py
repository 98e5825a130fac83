import math
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.io.engine_files import write_engine
from revline.studies.config import NUMBERS, StudyConfig, read_config, read_table_4_1

PAGE = (Path(__file__).parents[2] / "docs" / "study-files.md").read_text()
HEAD = 'schema = "revline.study-file/1"\n[study]\n'


def read(folder: Path, text: str) -> StudyConfig:
    path = folder / "STUDY.toml"
    path.write_text(text)
    return read_config(path)


def example() -> str:
    match = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert match is not None
    return match[1]


def test_the_documented_example_is_read(tmp_path: Path) -> None:
    config = read(tmp_path, example())
    assert config == StudyConfig()
    assert config.asks_what_the_thesis_asked
    written = {line.split("=")[0].strip() for line in example().splitlines() if "=" in line} - {"schema"} | {"frequencies_rad_s"}
    assert written == {f"{f.name}_rad_s" if "frequencies" in f.name else f.name for f in fields(StudyConfig)}


def test_the_documented_table_has_every_key_with_its_default() -> None:
    rows = {
        cells[1].strip(" `"): cells[4].strip(" `") for cells in (line.split("|") for line in PAGE.splitlines() if line.startswith("| `"))
    }
    default = StudyConfig()
    assert {name: float(rows[name]) for name, _ in NUMBERS} == {name: getattr(default, name) for name, _ in NUMBERS}
    assert rows["engine"].strip('"') == default.engine
    for key, name in (("steps_deg", "steps_deg"), ("spectrum_frequencies_rad_s", "spectrum_frequencies")):
        assert tuple(map(float, rows[key].split(","))) == getattr(default, name)
    assert len(default.frequencies) == 42 == len(read_table_4_1())


def test_another_question_at_the_same_point_is_not_checked_against_the_thesis() -> None:
    other = StudyConfig(frequencies=tuple(float(k) for k in range(1, 10)))
    assert other.is_the_thesis
    assert not other.asks_what_the_thesis_asked


def test_an_empty_study_is_the_thesis_s(tmp_path: Path) -> None:
    config = read(tmp_path, HEAD)
    assert config == StudyConfig()
    assert config.is_the_thesis
    assert config.load_engine().content_digest == lee1995().content_digest
    assert (config.starting_gains_g2 is None, config.starting_gains_g2d is None) == (False, False)
    assert replace(config, throttle_deg=26.0).starting_gains_g2 is None


@given(value=st.floats(-1e4, 1e4))
def test_numbers_are_read_to_the_last_bit(value: float, tmp_path_factory: pytest.TempPathFactory) -> None:
    assert read(tmp_path_factory.mktemp("study"), f"{HEAD}load_n_m = {value!r}\n").load_n_m == value


def test_an_engine_file_lies_where_the_study_file_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen from the study's folder, not from where the program runs; a built-in name is never a file."""
    inner, elsewhere = tmp_path / "inner", tmp_path / "elsewhere"
    for folder in (inner, elsewhere):
        folder.mkdir()
        write_engine(replace(lee1995(), name=folder.name), folder / "mine.toml")
    (inner / "lee1995").write_text("no engine")
    monkeypatch.chdir(elsewhere)
    assert read(inner, f'{HEAD}engine = "mine.toml"\n').load_engine().name == "inner"
    assert read(inner, f'{HEAD}engine = "../elsewhere/mine.toml"\n').load_engine().name == "elsewhere"
    assert read(inner, f'{HEAD}engine = "{elsewhere / "mine.toml"}"\n').load_engine().name == "elsewhere"
    assert read(inner, f'{HEAD}engine = "lee1995"\n').is_the_thesis
    (inner / "mine.toml").unlink()
    with pytest.raises(
        InvalidInputError, match=r"STUDY\.toml, line 3: study\.engine = 'mine\.toml' is no built-in engine .*no file .*inner/mine\.toml"
    ):
        read(inner, f'{HEAD}engine = "mine.toml"\n')


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("throtle_deg = 20.0", r"line 3: unknown key study\.throtle_deg, did you mean throttle_deg\?"),
        ('throttle_deg = "20"', r"line 3: study\.throttle_deg = '20' is a text; give a number in deg, without quotes"),
        ("throttle_deg = true", r"line 3: study\.throttle_deg = true is a boolean"),
        ("throttle_deg = nan", r"line 3: study\.throttle_deg = nan is no finite number"),
        ("throttle_deg = inf", r"line 3: study\.throttle_deg = inf is no finite number"),
        (f"throttle_deg = 1{'0' * 400}", r"line 3: study\.throttle_deg is too large an integer"),
        ("throttle_deg = 91.0", r"line 3: study\.throttle_deg = 91 deg is outside 0 to 90; mend the study file"),
        ("amplitude_deg = 0.0", r"line 3: study\.amplitude_deg = 0 deg is outside 1e-06 to 45"),
        ("half_range_deg = -1.0", r"line 3: study\.half_range_deg = -1 deg is outside 1e-06 to 45"),
        ("natural_frequency_rad_s = 0", r"line 3: study\.natural_frequency_rad_s = 0 rad/s is outside 1e-06 to 1e\+06"),
        ("damping_ratio = 0", r"line 3: study\.damping_ratio = 0 is outside 0.001 to 1000"),
        ("overshoot_limit = 1.0", r"line 3: study\.overshoot_limit = 1 is outside 0.0001 to 0.99"),
        ("load_n_m = 1e5", r"line 3: study\.load_n_m = 100000 N m is outside -10000 to 10000"),
        ("command_rad_s = 1e5", r"line 3: study\.command_rad_s = 100000 rad/s is outside"),
        (
            "amplitude_deg = 30.0",
            r"line 3: study\.amplitude_deg: -30 deg from 25 deg leads to -5 deg, outside the throttle's range of 0 to 90 deg",
        ),
        ("half_range_deg = 40.0", r"line 3: study\.half_range_deg: -40 deg from 25 deg leads to -15 deg"),
        ("steps_deg = [5.0, 66.0]", r"line 3: study\.steps_deg: \+66 deg from 25 deg leads to 91 deg"),
        ("steps_deg = []", r"line 3: study\.steps_deg must be at least one throttle step, none of them 0 and none twice"),
        ("steps_deg = [0.0]", r"line 3: study\.steps_deg must be at least one"),
        ("steps_deg = [5.0, 5.0]", r"line 3: study\.steps_deg must be at least one"),
        ("steps_deg = 5.0", r"line 3: study\.steps_deg = 5.0 is no list of finite numbers; write for example"),
        ('steps_deg = ["5"]', r"line 3: study\.steps_deg = \['5'\] is no list of finite numbers"),
        ("steps_deg = [true]", r"line 3: study\.steps_deg = \[True\] is no list of finite numbers"),
        ("steps_deg = [nan]", r"line 3: study\.steps_deg = \[nan\] is no list of finite numbers"),
        ("steps_deg = [inf]", r"line 3: study\.steps_deg = \[inf\] is no list of finite numbers"),
        (f"steps_deg = [1{'0' * 400}]", r"line 3: study\.steps_deg = \[10+\] is no list of finite numbers"),
        (
            "frequencies_rad_s = [1, 2, 3, 4, 5, 6, 7]",
            r"line 3: study\.frequencies_rad_s must be at least 8 rising frequencies above 0 rad/s",
        ),
        ("frequencies_rad_s = [1, 3, 2, 4, 5, 6, 7, 8]", r"line 3: study\.frequencies_rad_s must be at least 8 rising"),
        ("frequencies_rad_s = [1, 2, 2, 4, 5, 6, 7, 8]", r"line 3: study\.frequencies_rad_s must be at least 8 rising"),
        ("frequencies_rad_s = [0, 1, 2, 4, 5, 6, 7, 8]", r"line 3: study\.frequencies_rad_s must be at least 8 rising"),
        (
            "spectrum_frequencies_rad_s = []",
            r"line 3: study\.spectrum_frequencies_rad_s must be 6 rising frequencies above 0 rad/s, one for each of Figs 4",
        ),
        (
            "spectrum_frequencies_rad_s = [-1.0]",
            r"line 3: study\.spectrum_frequencies_rad_s must be 6 rising frequencies above 0 rad/s, one for each of Figs 4",
        ),
        (
            "spectrum_frequencies_rad_s = [6, 5, 4, 3, 2, 1]",
            r"line 3: study\.spectrum_frequencies_rad_s must be 6 rising frequencies above 0 rad/s, one for each of Figs 4",
        ),
        ("engine = 5", r"line 3: study\.engine = 5 is an integer; give a text in quotes"),
        ('engine = ""', r"line 3: study\.engine = '' is no printable text"),
        (
            'engine = "lee1996"',
            r"line 3: study\.engine = 'lee1996' is no built-in engine \(lee1995, lee1995-generic\), and there is no file",
        ),
        ("[other]", r"unknown key or section other"),
        ("throttle_deg = ", r"is no valid TOML"),
    ],
)
def test_every_bad_line_is_refused_with_its_place(line: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=rf"^study file .*STUDY\.toml.*{message}"):
        read(tmp_path, HEAD + line + "\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "schema is missing"),
        ("[study]\n", "schema is missing"),
        ('schema = "revline.study-file/2"\n[study]\n', r"schema = 'revline.study-file/2' cannot be read; this version reads"),
        ('schema = "revline.study-file/1"\n', r"section \[study\] is missing"),
        ('schema = "revline.study-file/1"\nstudy = 5\n', "not a section"),
        (f"{HEAD}throttle_deg = 20.0\nthrottle_deg = 21.0\n", "no valid TOML"),
    ],
)
def test_other_files_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=message):
        read(tmp_path, text)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"study file .*none\.toml does not exist; check the path"):
        read_config(tmp_path / "none.toml")
    with pytest.raises(InvalidInputError, match=r"study file .* is a directory"):
        read_config(tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"throttle_deg": math.nan}, r"study\.throttle_deg = nan deg is outside 0 to 90"),
        ({"frequencies": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, math.nan)}, "at least 8 rising frequencies"),
        ({"frequencies": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, math.inf)}, "at least 8 rising frequencies"),
        ({"steps_deg": (math.nan,)}, r"\+nan deg from 25 deg leads to nan deg"),
    ],
)
def test_questions_asked_in_python_are_checked_too(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        StudyConfig(**options)


def test_a_report_names_an_engine_file_without_this_machine_s_folders() -> None:
    assert [StudyConfig(engine=name).engine_title for name in ("lee1995", "/somewhere/here/mine.toml")] == ["lee1995", "mine.toml"]
