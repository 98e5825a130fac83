import json
from pathlib import Path

from .conftest import Command


def test_spark_and_throttle_beside_the_throttle_alone(revline: Command, tmp_path: Path) -> None:
    """Its numbers are tested with the functions; here, that what is shown is what was computed, and limits touched are warned of."""
    out, plot = tmp_path / "idle.csv", tmp_path / "idle.svg"
    done = revline(
        "mid-ranging",
        *("--throttle", 12, "--spark", -20, "--load-step", 8, "--until", 6, "--lag-spread", 0, "--out", out, "--plot", plot, "--json"),
    )
    assert done.status == 0
    record = json.loads(done.out)
    (plant,) = record["plants"]
    assert plant["mid_ranging"]["droop_rad_s"] < plant["throttle_alone"]["droop_rad_s"]
    assert "nominal, spark and throttle: spark stands at its limit for" in done.err
    assert record["warnings"]
    rows = [line.split(",") for line in out.read_text().splitlines() if not line.startswith("#")]
    speeds = [float(row[rows[0].index("mid_ranging_engine_speed_rad_s")]) for row in rows[1:]]
    assert speeds[0] - min(speeds) == plant["mid_ranging"]["droop_rad_s"]
    assert plot.read_text().startswith("<?xml")


def test_a_set_point_without_authority_is_refused(revline: Command) -> None:
    done = revline("mid-ranging", "--throttle", 12, "--spark", 0, "--load-step", 4)
    assert done.status == 2
    assert "no authority over indicated_torque" in done.err
    done = revline("mid-ranging", "--throttle", 12, "--load-step", 4, "--lag-spread", 100)
    assert done.status == 2
    assert "--lag-spread = 100 %" in done.err
