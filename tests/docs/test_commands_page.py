"""Every command shown in a `console` block of the commands' page runs, in order, and prints what the page says it prints."""

import doctest
import re
import shlex
from pathlib import Path

import pytest

from revline.cli import COMMANDS, run

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "commands.md"
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
BENCH = "f,gain,phase\n" + "".join(f"{0.1 * k},{20.0 - k},{-5.0 * k}\n" for k in range(1, 9))


def examples(text: str) -> list[tuple[str, str]]:
    """Commands of a page with what they print, `...` standing for anything."""
    found = []
    for block in BLOCK.findall(text):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            line, _, shown = part.partition("\n")
            found.append((line, shown))
    return found


def differs(shown: str, got: str) -> bool:
    return not doctest.OutputChecker().check_output(shown, got, OPTIONS)


def test_the_page_shows_each_command_that_works_alone() -> None:
    shown = {shlex.split(line)[1] for line, _ in examples(PAGE.read_text())}
    assert {entry.name for entry in COMMANDS} - {"study", "report", "compare", "serve"} <= shown  # these take long, or do not end


@pytest.mark.slow
def test_the_commands_of_the_page_print_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.csv").write_text(BENCH)
    (tmp_path / "hand.json").write_text('{"kp": 1.2, "ki": 2.0, "kd": 0.1}')
    for line, shown in examples(PAGE.read_text()):
        run(shlex.split(line)[1:])
        out, err = capsys.readouterr()
        got = out or err
        assert not differs(shown, got), f"{line}\n{got}"


def test_a_planted_wrong_number_is_found() -> None:
    ((line, shown),) = examples("text\n\n```console\n$ revline trim\n speed 240.8 rad/s\n...\n```\n")
    assert line == "revline trim"
    assert not differs(shown, "speed   240.8   rad/s\nmore\n")
    assert differs(shown, "speed   240.9   rad/s\nmore\n")
