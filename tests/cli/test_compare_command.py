import json
from pathlib import Path

from .conftest import Command


def write(path: Path, speed: float) -> Path:
    path.write_text(json.dumps({"schema": "revline.study/1", "operating_point": {"speed_rad_s": speed, "pressure_kpa": 35.8}}))
    return path


def test_two_studies_are_compared(revline: Command, tmp_path: Path) -> None:
    one, two = write(tmp_path / "one.json", 240.0), write(tmp_path / "two.json", 252.0)
    done = revline("compare", one, two, "--json")
    record = json.loads(done.out)
    assert (done.status, record["same"], record["compared"]) == (0, False, 2)
    assert record["differences"] == [{"path": "operating_point.speed_rad_s", "first": 240.0, "second": 252.0, "relative": 12.0 / 252.0}]
    shown = revline("compare", one, two).out
    assert "different" in shown
    assert "operating_point.speed_rad_s" in shown
    assert "the same" in revline("compare", one, one).out


def test_a_missing_study_is_refused(revline: Command, tmp_path: Path) -> None:
    done = revline("compare", write(tmp_path / "one.json", 240.0), tmp_path / "absent")
    assert done.status == 2
    assert "absent" in done.err
