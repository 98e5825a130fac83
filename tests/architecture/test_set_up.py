"""The search for a Python: what it takes, what it refuses, and the one line it prints for a machine that lacks something."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "scripts" / "find_python.sh"

WHOLE = f'#!/bin/sh\nexec "{sys.executable}" "$@"\n'
WITHOUT_ENSUREPIP = f'#!/bin/sh\ncase "$2" in *ensurepip*) exit 1;; esac\nexec "{sys.executable}" "$@"\n'
OLD = f"""#!/bin/sh
case "$2" in *ensurepip*) exit 0;; esac
exec "{sys.executable}" -c "import sys; sys.version_info = (3, 9, 2); $2"
"""
BROKEN_SHIM = "#!/bin/sh\necho 'command not found' >&2\nexit 127\n"
SILENT = "#!/bin/sh\nexit 0\n"


def machine(folder: Path, **commands: str) -> dict[str, str]:
    """A machine that has just these commands besides `id`; a dot in a name is written as two underscores."""
    for name, text in commands.items():
        path = folder / name.replace("__", ".").replace("_", "-")
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    (folder / "id").symlink_to("/usr/bin/id")
    return {"PATH": str(folder)}


def find_python(environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["/bin/sh", str(SCRIPT)], capture_output=True, text=True, check=False, env=environment)  # noqa: S603 - our own script


def remedy(done: subprocess.CompletedProcess[str]) -> str:
    """The line that mends it, without the sudo of a user who is not root."""
    assert done.returncode == 1
    assert done.stdout == ""
    why, line = done.stderr.splitlines()
    assert why.endswith("Mend it with:")
    return line.removeprefix("sudo ")


def test_a_whole_machine_gives_its_python(tmp_path: Path) -> None:
    done = find_python(machine(tmp_path, python3=WHOLE))
    assert done.returncode == 0
    assert os.access(done.stdout.strip(), os.X_OK)


def test_a_newer_python_stands_in_for_an_old_or_broken_one(tmp_path: Path) -> None:
    assert find_python(machine(tmp_path, python3=OLD, python3__13=BROKEN_SHIM, python3__12=WHOLE)).returncode == 0


def test_uv_makes_environments_without_ensurepip(tmp_path: Path) -> None:
    assert find_python(machine(tmp_path, python3=WITHOUT_ENSUREPIP, uv=SILENT)).returncode == 0


@pytest.mark.parametrize(
    ("commands", "expected"),
    [
        ({}, "apt-get install -y python3 python3-venv"),
        ({"python3": WITHOUT_ENSUREPIP}, "apt-get install -y python3-venv"),
        ({"python3": OLD, "python3__12": WITHOUT_ENSUREPIP}, f"apt-get install -y python3.{sys.version_info[1]}-venv"),
        ({"python3": OLD}, "apt-get install -y python3.11 python3.11-venv"),
    ],
    ids=["no python", "no ensurepip", "old python3 and no ensurepip", "old python3"],
)
def test_what_is_missing_is_named_in_one_line(tmp_path: Path, commands: dict[str, str], expected: str) -> None:
    assert remedy(find_python(machine(tmp_path, apt_get=SILENT, **commands))) == expected


def test_without_apt_the_package_is_named(tmp_path: Path) -> None:
    assert remedy(find_python(machine(tmp_path))) == "install python3 python3-venv with this system's package manager"


def test_a_half_made_environment_is_made_anew(tmp_path: Path) -> None:
    """An install that fails leaves no mark, and the next run starts from nothing."""
    for folder in ("scripts", "requirements"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / "left over").touch()
    commands = tmp_path / "commands"
    commands.mkdir()
    failing = "#!/bin/sh\ncase $1 in venv) mkdir .venv;; *) exit 3;; esac\n"
    environment = machine(commands, python3=WHOLE, uv=failing)
    environment["PATH"] += ":/usr/bin:/bin"
    done = subprocess.run(
        ["/bin/sh", "scripts/set_up.sh", "run"], cwd=tmp_path, capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 3
    assert list((tmp_path / ".venv").iterdir()) == []


def test_peers_are_added_to_a_whole_environment_only(tmp_path: Path) -> None:
    for folder in ("scripts", "requirements"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    commands = tmp_path / "commands"
    commands.mkdir()
    environment = machine(commands, python3=WHOLE, uv=SILENT)
    environment["PATH"] += ":/usr/bin:/bin"

    def set_up() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["/bin/sh", "scripts/set_up.sh", "bench"], cwd=tmp_path, capture_output=True, text=True, check=False, env=environment
        )

    refused = set_up()
    assert refused.returncode == 1
    assert ".venv is not whole; run make .venv/.dev first" in refused.stderr
    assert not (tmp_path / ".venv" / ".bench").exists()
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / ".dev").touch()
    assert set_up().returncode == 0
    assert (tmp_path / ".venv" / ".bench").exists()
