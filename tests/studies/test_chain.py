import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import revline
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits
from revline.errors import InvalidInputError, NotConvergedError
from revline.studies import chain as chain_module
from revline.studies.chain import FOLDER, Chain, Stopwatch, code_digest
from revline.studies.config import StudyConfig
from revline.values import fingerprint


class Counter:
    """Counts how often each step is made."""

    def __init__(self) -> None:
        self.made: list[str] = []

    def of(self, name: str, value: object) -> Callable[[], object]:
        def make() -> object:
            self.made.append(name)
            return value

        return make


def gains(kp: float) -> PidGains:
    return PidGains(kp=kp, ki=0.0, kd=0.0, input_unit="rad/s", output_unit="deg", rule="r", designed_on="m", details={"b": 1.0, "a": "x"})


def run(folder: Path, counter: Counter, *, origin: str = "o", first: object = None, kp: float = 1.0) -> tuple[object, ...]:
    """Three steps: the second is made from the first, the third from both."""
    links = Chain(folder=folder, origin=origin)
    one = links.step("one", counter.of("one", first or (np.arange(3.0), Limits())), share=(0.0, 0.1))
    two = links.step("two", counter.of("two", {"gains": gains(kp)}), one, share=(0.1, 0.5))
    return one, two, links.step("one-and-two", counter.of("one-and-two", (1.0, "text")), one, two, share=(0.5, 1.0))


def files(folder: Path) -> set[str]:
    return {path.name for path in (folder / FOLDER).iterdir()}


def test_kept_steps_are_reused_and_are_what_was_made(tmp_path: Path) -> None:
    counter = Counter()
    fresh = run(tmp_path, counter)
    before = files(tmp_path)
    again = run(tmp_path, counter)
    assert counter.made == ["one", "two", "one-and-two"]
    assert fingerprint(fresh) == fingerprint(again)
    assert files(tmp_path) == before
    assert [type(part) for part in fresh] == [type(part) for part in again]


def test_another_question_makes_all_steps_anew_and_leaves_no_old_ones(tmp_path: Path) -> None:
    counter = Counter()
    run(tmp_path, counter)
    before = files(tmp_path)
    run(tmp_path, counter, origin=fingerprint(StudyConfig(throttle_deg=26.0)))
    assert counter.made == 2 * ["one", "two", "one-and-two"]
    assert len(files(tmp_path)) == 3
    assert not files(tmp_path) & before


def test_a_changed_result_makes_those_anew_that_are_made_from_it(tmp_path: Path) -> None:
    """The result of `two` changes because its file is lost and its maker gives another; `one` stays, also by its like name."""
    counter = Counter()
    run(tmp_path, counter)
    for path in (tmp_path / FOLDER).glob("two-*.json"):
        path.unlink()
    run(tmp_path, counter, kp=2.0)
    assert counter.made == ["one", "two", "one-and-two", "two", "one-and-two"]


def test_a_step_does_not_remove_one_whose_name_begins_alike(tmp_path: Path) -> None:
    counter = Counter()
    links = Chain(folder=tmp_path, origin="o")
    links.step("models-of-table", counter.of("models-of-table", 1.0), share=(0.0, 0.5))
    links.step("models", counter.of("models", 1.0), 1.0, share=(0.5, 1.0))
    links.step("models", counter.of("models", 2.0), 2.0, share=(0.5, 1.0))
    assert {name.rpartition("-")[0] for name in files(tmp_path)} == {"models", "models-of-table"}
    assert len(files(tmp_path)) == 2
    links.step("models-of-table", counter.of("models-of-table", 1.0), share=(0.0, 0.5))
    assert counter.made == ["models-of-table", "models", "models"]


@pytest.mark.parametrize("damage", ["", "{", '{"schema": "revline.value/1", "value": {"class": "os:system", "fields": {}}}', None])
def test_a_damaged_step_is_made_again(tmp_path: Path, damage: str | None) -> None:
    counter = Counter()
    fresh = run(tmp_path, counter)
    (path,) = (tmp_path / FOLDER).glob("two-*.json")
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2] if damage is None else damage)
    again = run(tmp_path, counter)
    assert counter.made == ["one", "two", "one-and-two", "two"]
    assert fingerprint(again) == fingerprint(fresh)
    assert path.read_text() == whole


@pytest.mark.parametrize("error", [KeyboardInterrupt, NotConvergedError])
def test_an_interruption_leaves_what_is_finished(tmp_path: Path, error: type[BaseException]) -> None:
    counter = Counter()
    links = Chain(folder=tmp_path, origin="o")
    one = links.step("one", counter.of("one", (np.arange(3.0), Limits())), share=(0.0, 0.1))

    def fail() -> float:
        raise error("stopped")

    with pytest.raises(error, match="stopped"):
        links.step("two", fail, one, share=(0.1, 0.5))
    assert {name.rpartition("-")[0] for name in files(tmp_path)} == {"one"}
    run(tmp_path, counter)
    assert counter.made == ["one", "two", "one-and-two"]


def test_two_chains_in_one_folder_never_take_one_another_s_results(tmp_path: Path) -> None:
    """They may remove one another's steps; what each gets is its own."""
    here, there = Chain(folder=tmp_path, origin="here"), Chain(folder=tmp_path, origin="there")
    for _ in range(2):
        assert here.step("one", lambda: "here", share=(0.0, 1.0)) == "here"
        assert there.step("one", lambda: "there", share=(0.0, 1.0)) == "there"


def test_other_code_takes_no_old_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counter = Counter()
    run(tmp_path, counter)
    monkeypatch.setattr(chain_module, "code_digest", lambda: "0" * 32)
    run(tmp_path, counter)
    assert counter.made == 2 * ["one", "two", "one-and-two"]


def test_the_digest_of_the_code_sees_every_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An equation, a table of reference values, a new module; but nothing that compilers leave behind."""
    root = tmp_path / "revline"
    shutil.copytree(Path(revline.__file__).parent, root, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(revline, "__file__", str(root / "__init__.py"))
    found = [code_digest.__wrapped__()]
    assert found[0] == code_digest()
    (root / "__pycache__").mkdir()
    (root / "__pycache__" / "left.nbi").write_text("left")
    assert code_digest.__wrapped__() == found[0]
    for name in ("engine/air.py", "studies/reference/table_4_1.csv", "new.py"):
        with (root / name).open("a") as file:
            file.write("\n")
        found.append(code_digest.__wrapped__())
    monkeypatch.setattr("importlib.metadata.version", lambda _: "0")
    found.append(code_digest.__wrapped__())
    assert len(set(found)) == len(found)


def test_progress_is_told_whether_a_step_is_made_or_taken(tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []
    links = Chain(folder=tmp_path, origin="o", report=lambda name, part: told.append((name, part)))
    for _ in range(2):
        links.step("one", lambda: 1.0, share=(0.25, 0.5))
    assert told == 2 * [("one", 0.25), ("one", 0.5)]


def test_what_cannot_be_kept_is_refused_when_it_is_made(tmp_path: Path) -> None:
    """Else it would be made anew each time, or read as something else."""
    links = Chain(folder=tmp_path, origin="o")
    with pytest.raises(InvalidInputError, match="a value of type list cannot be written"):
        links.step("one", lambda: [1.0], share=(0.0, 1.0))
    assert files(tmp_path) == set()


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError, match=r"folder .*file/study/steps cannot be made: Not a directory; give a folder that may be"):
        Chain(folder=tmp_path / "file" / "study", origin="o").step("one", lambda: 1.0, share=(0.0, 1.0))


def test_a_stopwatch_runs() -> None:
    watch = Stopwatch()
    assert 0.0 <= watch.seconds <= watch.seconds + 1e-9
    assert Stopwatch(start=watch.start - 5.0).seconds >= 5.0
