import json
from pathlib import Path

import numpy as np
import pytest

from .conftest import Command


@pytest.fixture
def c2d(tmp_path: Path) -> Path:
    path = tmp_path / "c2d.json"
    path.write_text('{"kp": 1.2, "ki": 2.0, "kd": 0.1}')
    return path


@pytest.fixture
def g2d(tmp_path: Path) -> Path:
    path = tmp_path / "g2d.json"
    path.write_text('{"numerator": [12.0066], "denominator": [1.0, 0.55159, 0.034396], "delay_s": 0.0213}')
    return path


def test_a_model_that_serves_and_one_that_does_not(revline: Command, g1: Path, c1: Path, g2d: Path, c2d: Path) -> None:
    serves = json.loads(revline("nu-gap", g2d, "--throttle", 25, "--controller", c2d, "--json").out)
    assert (serves["guaranteed"], serves["second_stable"]) == (True, True)
    assert serves["gap"] < serves["margin"]
    assert 0.0 < serves["margin_floor"] <= serves["margin_floor_by_frequency"] <= serves["second_margin"]
    assert serves["summary"].startswith("the nu-gap 0.171 is below c2d's margin 0.309 on g2d: it is sure to stabilise lee1995 at 25 deg")
    done = revline("nu-gap", g1, "--throttle", 25, "--controller", c1)
    assert done.status == 0
    assert "exceeds c1's margin 0.6" in done.out
    assert (
        "g1 says nothing about this loop on lee1995 at 25 deg, 0 N m; by its own count the loop there is unstable, with 2 poles" in done.out
    )
    fails = json.loads(revline("nu-gap", g1, "--throttle", 25, "--controller", c1, "--json").out)
    assert (fails["guaranteed"], fails["second_stable"], fails["second_unstable_poles"]) == (False, False, 2)
    assert not {"margin_floor", "second_margin"} & fails.keys()


def test_no_guarantee_is_no_instability(revline: Command, g2d: Path, c2d: Path) -> None:
    done = revline("nu-gap", g2d, "--throttle", 30, "--controller", c2d)
    assert "by its own count the loop there is stable" in done.out


def test_the_winding_number_and_a_first_loop_that_is_unstable(revline: Command, g1: Path, g2d: Path, c1: Path, tmp_path: Path) -> None:
    unstable = revline("nu-gap", g2d, g1, "--controller", c1)
    assert "c1 does not stabilise g2d itself" in unstable.out
    assert "margin" not in json.loads(revline("nu-gap", g2d, g1, "--controller", c1, "--json").out)
    one, two = tmp_path / "one.json", tmp_path / "two.json"
    one.write_text('{"numerator": [0.4], "denominator": [1.0, 1.0], "delay_s": 0.0}')
    two.write_text('{"numerator": [-0.4], "denominator": [1.0, -1.0], "delay_s": 0.0}')
    assert "winding number" in revline("nu-gap", one, two).out
    gains = tmp_path / "p.json"
    gains.write_text('{"kp": 1.0, "ki": 0.0, "kd": 0.0}')
    assert "do not turn alike: one says nothing about this loop on two" in revline("nu-gap", one, two, "--controller", gains).out


def test_without_a_controller_the_units_are_told(revline: Command, g1: Path, g2d: Path) -> None:
    done = revline("nu-gap", g1, g2d, "--json")
    record = json.loads(done.out)
    assert record["units"] == {"input": "deg", "output": "rad/s"}
    assert "depends on units, here deg to rad/s" in done.err
    assert record["warnings"] == [done.err.strip().removeprefix("warning: ")]
    assert revline("nu-gap", g1, g2d, "--quiet").err == ""
    assert record["gap"] == pytest.approx(json.loads(revline("nu-gap", g2d, g1, "--json").out)["gap"], abs=1e-9)


def test_chords_and_figure_are_written(revline: Command, g2d: Path, c2d: Path, tmp_path: Path) -> None:
    table, figure, vector = tmp_path / "chords.csv", tmp_path / "chords.png", tmp_path / "chords.svg"
    arguments = ("nu-gap", g2d, "--throttle", 25, "--controller", c2d, "--load", 10)
    assert revline(*arguments, "--out", table, "--plot", figure).status == 0
    assert revline(*arguments, "--plot", vector).status == 0
    record = json.loads(revline(*arguments, "--json").out)
    columns = np.genfromtxt(table, names=True, delimiter=",", skip_header=5)
    assert max(columns["chord_1"]) == pytest.approx(record["gap"], rel=2e-3)
    assert min(columns["chord_to_oscillation_1"]) == pytest.approx(record["margin"], rel=2e-3)
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in vector.read_bytes()


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ((), "give that, or a second model file"),
        (("--throttle", 25, "--plot", "x.pdf"), "the file one of these endings"),
        (("--throttle", 25, "--plot", "x.png"), "give --controller, or leave --plot out"),
        (("--throttle", 95), "throttle = 95 deg"),
        (("g.json", "--throttle", 25), "two model files need none, leave them out"),
        (("g.json", "h.json"), "3 files were given; give one model file or two"),
    ],
)
def test_what_is_refused(revline: Command, g2d: Path, extra: tuple[object, ...], words: str) -> None:
    done = revline("nu-gap", g2d, *extra)
    assert done.status == 2
    assert words in " ".join(done.err.split())
    assert done.out == ""
