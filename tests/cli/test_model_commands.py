import json
from pathlib import Path

import pytest

from revline.io.controller_files import read_controller
from revline.io.model_files import read_model

from .conftest import Command


def fitted(revline: Command, table: Path, *arguments: object) -> dict[str, object]:
    done = revline("fit", table, *arguments, "--json", "-q")
    assert (done.status, done.err) == (0, "")
    return dict(json.loads(done.out))


@pytest.mark.reference
@pytest.mark.parametrize(
    ("arguments", "numerator", "denominator"),
    [
        (("--zeros", 0, "--poles", 1), [12.21634], [1, 0.579381]),
        (("--zeros", 0, "--poles", 2), [12.006617], [1, 0.551588, 0.0343956]),
        (("--zeros", 1, "--poles", 2), [12.004151, -0.1765447], [1, 0.541338, 0.0266264]),
    ],
)
def test_fit_gives_table_4_2(
    arguments: tuple[object, ...], numerator: list[float], denominator: list[float], revline: Command, table: Path
) -> None:
    """Lee (1995), Table 4.2, from Table 4.1 with unit weights, converged."""
    record = fitted(revline, table, *arguments)
    assert record["numerator"] == pytest.approx(numerator, rel=2e-4)
    assert record["denominator"] == pytest.approx(denominator, rel=2e-4)
    assert record["delay_s"] == 0.0


@pytest.mark.reference
def test_fit_gives_the_poles_of_g3_and_the_delay_of_g2d(revline: Command, table: Path) -> None:
    """Lee (1995), Tables 4.2 and 6.1."""
    poles = fitted(revline, table, "--zeros", 0, "--poles", 3)["poles"]
    assert poles == [pytest.approx([p, 0.0], rel=2e-4, abs=1e-9) for p in (-2.0435, -26.47, -33.81)]
    record = fitted(revline, table, "--zeros", 0, "--poles", 2, "--delay", "phase-line")
    assert record["delay_s"] == pytest.approx(0.02130, abs=1e-5)
    assert record["accepted"] is True
    assert str(record["verdict"]).startswith("accepted, with a delay of 0.0213 s")


def test_fit_says_where_the_data_do_not_determine_a_model(revline: Command, tmp_path: Path, table: Path) -> None:
    path = tmp_path / "few.csv"
    path.write_text("frequency_rad_s,magnitude,phase_deg\n0.1,12.0,-4.0\n100,0.03,-330\n")
    done = revline("fit", path, "--zeros", 0, "--poles", 2, "--json")
    (reason,) = json.loads(done.out)["undetermined"]
    assert reason.startswith("its denominator's last coefficient may as well be 0 (")
    assert "warning: the data do not determine the model: its denominator" in " ".join(done.err.split())
    assert fitted(revline, table, "--zeros", 0, "--poles", 2)["undetermined"] == []


def test_fit_writes_a_model_file_with_what_people_see(revline: Command, table: Path, tmp_path: Path) -> None:
    path = tmp_path / "g2d.json"
    done = revline("fit", table, "--zeros", 0, "--poles", 2, "--delay", "phase-line", "--out", path)
    assert done.status == 0
    file = read_model(path)
    assert file.name == "g2d"
    assert file.model.delay == json.loads(path.read_text())["delay_s"]
    assert file.provenance["data"] == "table_4_1.csv"
    assert file.provenance["delay_rule"] == "phase-line"
    assert f"written: {path}" in done.out
    assert "accepted, with a delay of 0.0213 s" in done.out
    assert "does not give the input amplitude: 5 deg assumed" in done.err


def test_columns_of_other_names_are_found(revline: Command, tmp_path: Path) -> None:
    data = tmp_path / "bench.csv"
    rows = [(w, 12.0 / abs(1 + 0.5j * w), f"{-((w * 0.5) ** 0):g}") for w in (0.1, 1.0, 3.0, 10.0)]
    data.write_text("f;g;p\n" + "".join(f"{w};{m};{p}\n" for w, m, p in rows))
    done = revline("fit", data, "--zeros", 0, "--poles", 1, "--columns", "frequency_rad_s=f,magnitude=g,phase_deg=p", "--json")
    assert done.status == 0
    assert json.loads(done.out)["provenance"]["data"] == "bench.csv"


CSV = {
    "empty.csv": ("", "is empty"),
    "no_rows.csv": ("frequency_rad_s,magnitude,phase_deg\n", "has a header and no rows"),
    "ragged.csv": ("frequency_rad_s,magnitude,phase_deg\n1,2,3\n2,2\n", "line 3: 2 cells where the header names 3 columns"),
    "unsorted.csv": ("frequency_rad_s,magnitude,phase_deg\n2,2,3\n1,2,3\n", "line 3, column frequency_rad_s: the frequency is below"),
    "twice.csv": ("frequency_rad_s,magnitude,phase_deg\n1,2,3\n1,2,3\n", "line 3, column frequency_rad_s: the frequency repeats"),
    "words.csv": ("frequency_rad_s,magnitude,phase_deg\n1,two,3\n", "line 2, column magnitude: 'two' is no finite number"),
    "nan.csv": ("frequency_rad_s,magnitude,phase_deg\n1,nan,3\n", "line 2, column magnitude: 'nan' is no finite number"),
    "zero.csv": ("frequency_rad_s,magnitude,phase_deg\n0,2,3\n", "is not positive"),
    "no_phase.csv": ("frequency_rad_s,magnitude\n1,2\n", "no phase column"),
    "few.csv": ("frequency_rad_s,magnitude,phase_deg\n1,2,3\n", "frequencies give 2 numbers for"),
}


@pytest.mark.parametrize("name", CSV)
def test_a_bad_table_is_refused_with_file_and_line(name: str, revline: Command, tmp_path: Path) -> None:
    text, message = CSV[name]
    path = tmp_path / name
    path.write_text(text)
    done = revline("fit", path, "--zeros", 0, "--poles", 2)
    assert (done.status, done.out) == (2, "")
    assert message in done.err
    assert len([line for line in done.err.splitlines() if line.startswith("error: ")]) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--zeros", 2, "--poles", 1), "2 zeros and 1 poles make no proper transfer function"),
        (("--zeros", 0, "--poles", 1, "--amplitude", 0), "amplitude = 0 deg is outside above 0"),
        (("--zeros", 0, "--poles", 1, "--columns", "phase_deg"), "'phase_deg' is no pair; give KEY=VALUE"),
        (("--zeros", 0, "--poles", 1, "--columns", "colour=a"), "colour is no quantity of a frequency response"),
    ],
)
def test_what_fit_refuses(arguments: tuple[object, ...], message: str, revline: Command, table: Path) -> None:
    done = revline("fit", table, *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.err


@pytest.mark.reference
def test_pole_placement_gives_c1(c1: Path) -> None:
    """Lee (1995), chapter 5: kp = 2.153, ki = 16.85."""
    gains = read_controller(c1).gains
    assert gains.kp == pytest.approx(2.153, abs=5e-4)
    assert gains.ki == pytest.approx(16.85, abs=5e-3)
    assert (gains.kd, gains.designed_on) == (0.0, "g1")
    assert json.loads(c1.read_text())["provenance"]["model"] == "g1.json"


def test_rules_are_listed_with_their_options(revline: Command) -> None:
    done = revline("tune", "--list")
    assert "--natural-frequency [rad/s], --damping [1]" in " ".join(done.out.split()) or "--natural-frequency" in done.out
    names = [rule["name"] for rule in json.loads(revline("tune", "--list", "--json").out)["rules"]]
    assert names[:2] == ["pole-placement", "ziegler-nichols"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give a model file, or --throttle for the engine, and --rule"),
        (("--rule", "guess"), "there is no tuning rule 'guess'"),
        (("--rule", "pole-placement", "--damping", 1), "needs natural_frequency [rad/s]"),
        (("--rule", "ziegler-nichols", "--damping", 1), "knows no option damping"),
        (("--rule", "pole-placement", "--natural-frequency", -2, "--damping", 1), "natural frequency = -2 rad/s is outside"),
        (("--rule", "ziegler-nichols"), "needs a dead time"),
    ],
)
def test_what_tune_refuses(arguments: tuple[object, ...], message: str, revline: Command, g1: Path) -> None:
    done = revline("tune", g1, *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.err


def test_a_file_of_another_kind_is_refused(revline: Command, c1: Path, tmp_path: Path) -> None:
    assert "its schema is 'revline.controller/1'" in revline("tune", c1, "--rule", "ziegler-nichols").err
    assert "cannot be read" in revline("tune", tmp_path / "absent.json", "--rule", "ziegler-nichols").err


def test_the_set_point_weight_that_a_rule_recommends_is_part_of_its_controller(revline: Command, tmp_path: Path) -> None:
    """AMIGO asks for 0 where the lag dominates, as at 25 deg, and the PI form for 1."""
    for rule, weight in (("amigo", 0.0), ("amigo-pi", 1.0)):
        assert revline("tune", "--throttle", 25, "--rule", rule, "--out", tmp_path / "made.json").status == 0
        assert read_controller(tmp_path / "made.json").controller.setpoint_weight == weight


def test_fine_tuning_from_a_controller_file(revline: Command, table: Path, tmp_path: Path) -> None:
    g2d, start, out = tmp_path / "g2d.json", tmp_path / "start.json", tmp_path / "c2d.json"
    revline("fit", table, "--zeros", 0, "--poles", 2, "--delay", "phase-line", "--out", g2d, "-q")
    start.write_text('{"kp": 1.2, "ki": 2.0, "kd": 0.1}')
    wishes = ("--start", start, "--objective", "load-error", "--overshoot-limit", 0.09)
    done = revline("tune", g2d, "--rule", "fine-tuning", *wishes, "--out", out)
    assert done.status == 0
    assert "minimised the integrated error after a unit step of a load" in done.out
    gains = read_controller(out).gains
    assert 2.1 < gains.ki < 2.25
    assert (gains.kp, gains.kd, gains.rule, gains.designed_on) == (1.2, 0.1, "fine-tuning", "g2d")
    refused = revline("tune", g2d, "--rule", "fine-tuning", "--free", "kq")
    assert (refused.status, refused.out) == (2, "")
    assert "gain kq cannot be tuned" in refused.err
