"""What the commands of a loop share: no option of an engine is ignored beside a file, and no result is lost to another."""

from pathlib import Path

import pytest

from .conftest import Command

MODEL = '{"numerator": [12.0], "denominator": [1.0, 0.55, 0.034], "delay_s": 0.02, "input_unit": "deg", "output_unit": "rad/s"}'
CONTROLLER = '{"kp": 1.2, "ki": 2.0, "kd": 0.1}'


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("g.json").write_text(MODEL)
    Path("c.json").write_text(CONTROLLER)


@pytest.mark.parametrize("option", [("--engine", "lee1995-generic"), ("--engine", "absent.toml"), ("--throttle", "25"), ("--load", "3")])
@pytest.mark.parametrize("command", [("margins", "g.json", "c.json"), ("region", "g.json"), ("nu-gap", "g.json", "g.json")])
def test_an_engine_beside_a_file_of_the_plant_is_refused(command: tuple[str, ...], option: tuple[str, str], revline: Command) -> None:
    done = revline(*command, *option)
    assert done.status == 2
    assert "--engine, --throttle and --load place an engine's trim" in " ".join(done.err.split())
    assert revline(*command).status == 0


@pytest.mark.parametrize(
    ("command", "first", "second"),
    [
        (("region", "g.json", "--out", "one.csv", "--csv", "./one.csv"), "region", "table of gains"),
        (("region", "g.json", "--plot", "one.png", "--out", "one.png"), "region", "figure"),
        (("nu-gap", "g.json", "g.json", "--controller", "c.json", "--plot", "one.svg", "--out", "one.svg"), "table of chords", "figure"),
    ],
)
def test_two_results_for_one_file_are_refused(command: tuple[str, ...], first: str, second: str, revline: Command) -> None:
    done = revline(*command)
    assert done.status == 2
    assert f"the {first} and the {second} cannot both be written to" in " ".join(done.err.split())
    assert not list(Path().glob("one.*"))


@pytest.mark.parametrize("command", [("region", "g.json"), ("nu-gap", "g.json", "g.json", "--controller", "c.json")])
def test_figures_are_written_in_the_form_of_their_ending(command: tuple[str, ...], revline: Command) -> None:
    assert revline(*command, "--plot", "f.png").status == 0
    assert Path("f.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert revline(*command, "--plot", "f.svg").status == 0
    assert b"<svg" in Path("f.svg").read_bytes()
    done = revline(*command, "--plot", "f.pdf")
    assert done.status == 2
    assert "a figure is written as .png or .svg" in " ".join(done.err.split())
