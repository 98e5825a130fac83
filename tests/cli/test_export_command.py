"""The command export: what it writes runs, and what it refuses."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from revline.io.c_controller import COMPILE

from .conftest import Command


def controller(folder: Path, **entries: Any) -> Path:
    path = folder / "controller.json"
    path.write_text(json.dumps({"kp": 1.2, "ki": 2.0, "kd": 0.1, **entries}))
    return path


def test_every_format_is_written_and_the_c_code_compiles(revline: Command, tmp_path: Path) -> None:
    out = tmp_path / "code"
    done = revline("export", controller(tmp_path), "--format", "all", "--throttle", 25, "--name", "idle", "--out", out, "--json")
    assert done.status == 0
    record = json.loads(done.out)
    assert [Path(file).name for file in record["files"]] == ["idle.c", "idle.m", "idle_control.py", "idle.json"]
    assert record["rest"]["measurement"] == pytest.approx(240.799, abs=1e-3)
    assert subprocess.run([*COMPILE.split(), "idle.c"], cwd=out, check=False).returncode == 0  # noqa: S603 - the compiler
    content = json.loads((out / "idle.json").read_text())
    assert content["sampled_parameters"]["high"] == pytest.approx(79.46)
    assert content["sampling"] == {"kind": "fixed-rate", "period_s": 0.005, "computation_delay_s": 0.0}
    ecu = content["engine_computer_units"]
    assert ecu["kp_percent_per_rpm"] == pytest.approx(1.2 * np.pi / 30.0 * 100.0 / 79.46)
    assert ecu["ki_percent_per_rpm_and_sample"] == pytest.approx(2.0 * 0.005 * np.pi / 30.0 * 100.0 / 79.46)
    assert ecu["kd_percent_s_per_rpm"] == pytest.approx(0.1 * np.pi / 30.0 * 100.0 / 79.46)
    assert ecu["period_ms"] == 5.0
    again = revline("export", out / "idle.json", "--format", "c", "--rest-output", 25, "--out", tmp_path / "again")
    assert again.status == 0


def test_the_c_file_is_its_own_header_and_two_controllers_fit_into_one_program(revline: Command, tmp_path: Path) -> None:
    for name, precision in (("slow", "double"), ("fast", "float")):
        options = ["--format", "c", "--name", name, "--precision", precision, "--throttle", 25, "--out", tmp_path]
        assert revline("export", controller(tmp_path), *options).status == 0
    main = "".join(f'#define {name}_DECLARATIONS\n#include "{name.lower()}.c"\n' for name in ("SLOW", "FAST")) + MAIN
    (tmp_path / "main.c").write_text(main)
    for name in ("slow", "fast", "main"):
        strict = ["-Wconversion", "-Wshadow", "-Wdouble-promotion", "-fsanitize=undefined"]
        assert subprocess.run([*COMPILE.split(), *strict, f"{name}.c"], cwd=tmp_path, check=False).returncode == 0  # noqa: S603 - the compiler
    linking = ["gcc", "-fsanitize=undefined", "main.o", "slow.o", "fast.o", "-o", "main"]
    assert subprocess.run(linking, cwd=tmp_path, check=False).returncode == 0  # noqa: S603 - the compiler
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)  # noqa: S603 - what was compiled
    slow, fast = (float(word) for word in done.stdout.split())
    assert slow == pytest.approx(25.0 + 1.2 * 1.0 + 2.0 * 0.005 + 0.1 * 1.0 / 0.005, rel=1e-9)
    assert fast == pytest.approx(slow, rel=1e-4)


MAIN = """
#include <stdio.h>
int main(void)
{
    slow_state a = slow_start(240.0, 240.0, 25.0);
    fast_state b = fast_start(240.0f, 240.0f, 25.0f);
    printf("%.17g %.9g\\n", slow_step(&a, 239.0, 240.0, 0.005).control, (double)fast_step(&b, 239.0f, 240.0f, 0.005f).control);
    return 0;
}
"""


def test_the_json_of_a_schedule_reads_back_as_the_same_controller(revline: Command, tmp_path: Path) -> None:
    """Its gains are in tables: were they written as those of one PID, the file would be a controller that does nothing."""
    axes = [{"name": "engine_speed", "unit": "rad/s", "values": [100, 400]}, {"name": "load_torque", "unit": "N m", "values": [0, 40]}]
    tables = {"kp": [[0.2, 0.3], [0.5, 0.6]], "ki": [[0.4, 0.4], [1.5, 1.5]], "kd": [[0, 0], [0, 0]]}
    schedule = {"axes": axes, **tables, "powers_of_first_axis": {"kp": 1, "ki": 2, "kd": 0}}
    sampling = {"kind": "fixed-rate", "period_s": 0.002}
    (tmp_path / "s.json").write_text(json.dumps({"schedule": schedule, "output_high": 60.0, "sampling": sampling}))
    for file, out in ((tmp_path / "s.json", tmp_path / "one"), (tmp_path / "one" / "s.json", tmp_path / "two")):
        options = ["--format", "c,json", "--name", "s", "--throttle", 25, "--setpoint-weight", 0.3, "--out", out]
        assert revline("export", file, *options).status == 0
    one, two = ((tmp_path / folder / "s.c").read_text() for folder in ("one", "two"))
    assert one == two
    assert "(real)60.0, /* law_high */" in one
    assert "(real)0.3, /* law_setpoint_weight */" in one
    content = json.loads((tmp_path / "two" / "s.json").read_text())
    assert content["schedule"]["kp"] == tables["kp"]
    assert content["sampling"]["period_s"] == 0.002


def test_the_objects_of_python_control_are_the_law(revline: Command, tmp_path: Path) -> None:
    """Continuous and sampled, with weights and a filter, at some frequencies."""
    control = pytest.importorskip("control")
    file = controller(tmp_path, setpoint_weight=0.5, derivative_weight=0.25, filter_time_s=0.02)
    assert revline("export", file, "--format", "control", "--period", 0.01, "--out", tmp_path).status == 0
    made: dict[str, Any] = {}
    exec((tmp_path / "speed_controller_control.py").read_text(), made)  # noqa: S102 - what the command wrote
    for omega in (0.3, 5.0, 60.0):
        s, z = 1j * omega, np.exp(1j * omega * 0.01)
        derivative, difference = 0.1 * s / (0.02 * s + 1.0), 1.0 - 1.0 / z
        sampled_derivative = 0.1 * difference / (0.01 + 0.02 * difference)
        for name, point, wanted in (
            ("from_command", s, 0.6 + 2.0 / s + 0.25 * derivative),
            ("from_measurement", s, 1.2 + 2.0 / s + derivative),
            ("sampled_from_command", z, 0.6 + 0.02 / difference + 0.25 * sampled_derivative),
            ("sampled_from_measurement", z, 1.2 + 0.02 / difference + sampled_derivative),
        ):
            assert complex(control.evalfr(made[name], point)) == pytest.approx(wanted, rel=1e-9), name


def test_the_matlab_function_says_the_same_as_the_c_code(revline: Command, tmp_path: Path) -> None:
    """Both come from one record of operations: expression by expression they differ in notation only."""
    assert revline("export", controller(tmp_path), "--format", "c,matlab", "--out", tmp_path).status == 0
    c, m = (tmp_path / "speed_controller.c").read_text(), (tmp_path / "speed_controller.m").read_text()
    in_c = [line.strip().removeprefix("const real ") for line in c.splitlines() if line.strip().startswith("const real v")]
    in_m = [line.strip() for line in m.splitlines() if line.strip().startswith("v") and " = " in line]
    steps = in_c[-len(in_m) :]
    plain = [line.replace("(real)", "").replace("fmin_", "fmin").replace("fmax_", "fmax").replace("state->", "state.") for line in steps]
    assert plain == in_m
    assert len(in_m) > 15
    assert m.count("\nfunction ") == 4


@pytest.mark.parametrize(
    ("entries", "options", "words"),
    [
        ({}, ["--format", "fortran"], "there is no format 'fortran'; there are c, matlab, control, json, and all"),
        ({"input_unit": "rpm"}, ["--format", "c", "--throttle", "25"], "the controller measures in rpm and the engine's trim is in rad/s"),
        ({"output_unit": "%"}, ["--format", "c", "--throttle", "25"], "the controller drives in % and the engine's trim is in deg"),
        ({"kp": 0, "ki": 0, "kd": 0}, ["--format", "c"], "all gains of the controller are 0, so that its code would do nothing"),
        ({}, ["--format", "c", "--name", "Idle"], "is no name for C code"),
        ({}, ["--format", "c", "--load", "5"], "without --throttle the controller rests where"),
        ({}, ["--format", "c", "--throttle", "25", "--rest-output", "3"], "each say where the controller rests; give one"),
        ({"output_low": 5, "output_high": 20}, ["--format", "c", "--throttle", "25"], "output at rest = 25 deg is outside"),
        ({"output_low": 5, "output_high": 20}, ["--format", "c", "--rest-output", "2"], "output at rest = 2 deg is outside"),
        ({"output_step": 1e-9}, ["--format", "c", "--precision", "float", "--throttle", "25"], "output step = 1e-09 deg is outside"),
        ({"sampling": {"period_s": 0.01}}, ["--format", "c", "--period", "0.02"], "says itself when its controller samples"),
        ({"input_unit": "kPa"}, ["--format", "json"], "gains per rpm need a speed in rad/s; this controller measures in kPa"),
        ({"output_low": 5, "output_high": 4}, ["--format", "c"], "is not below the upper"),
    ],
)
def test_what_cannot_be_exported_is_refused(revline: Command, tmp_path: Path, entries: Any, options: list[str], words: str) -> None:
    done = revline("export", controller(tmp_path, **entries), *options, "--out", tmp_path / "out")
    assert done.status == 2
    assert words in " ".join(done.err.split())


def test_a_folder_that_cannot_be_made_is_told(revline: Command, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = revline("export", controller(tmp_path), "--format", "c", "--out", tmp_path / "file" / "x")
    assert done.status == 2
    assert "cannot be made" in done.err
