#!/usr/bin/env python3
"""Try every command of revline as a user would, and check values, files, exit statuses and messages.

Usage: check_commands.py [REVLINE] [--self-test] [--only=FILE]. What is tried stands in commands/*.toml; --only tries one of these files,
by its name without the ending. The commands of one file run in a folder of its own. As many commands run side by side as there are
processors; one that names a file which an earlier one of the same toml file names too, other than those both were given, waits for that
one. REVLINE is the program, by default the `revline` beside this Python or on the path.
Exits 0 when all hold, prints each line that falls short, then 'N passed, M failed'. With --self-test each answer is also altered on
purpose (a number moved, an exit status changed, a traceback added), and an altered answer that passes counts as a failure.
Standard library only. Values: K. Lee, MSc thesis, University of Southern California, 1995, and converged computations.
"""

import csv
import json
import math
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from json_values import agrees, find, move
from side_by_side import PROCESSORS, files_named, files_written, run_in_order

HERE = Path(__file__).resolve().parent
TABLE = HERE.parent / "reference" / "table_4_1.csv"
LONGEST = 600.0
"""Seconds that one command may take."""

ELSEWHERE = frozenset({"study", "report", "compare", "serve"})
"""Commands that are tried in a way of their own: the first three below, the server by check_serve.py."""

RUNNING = threading.BoundedSemaphore(PROCESSORS)
"""Lets as many commands run at once as there are processors."""


class Value(NamedTuple):
    """A command that must succeed: what its JSON must hold (path, value, tolerance), and what must be absent from it."""

    arguments: tuple[str, ...]
    expected: tuple[tuple[str, Any, float], ...]
    absent: tuple[str, ...]


class Refusal(NamedTuple):
    """A command that must fail: its exit status, and words of its message."""

    arguments: tuple[str, ...]
    status: int
    words: tuple[str, ...]


class Done(NamedTuple):
    """What a command left."""

    status: int
    out: str
    err: str


def refuse_constant(name: str) -> float:
    message = f"{name} is no JSON number"
    raise ValueError(message)


def check_frame(done: Done, status: int) -> list[str]:
    """What holds for every command: its exit status, and no traceback anywhere."""
    faults = []
    if done.status != status:
        faults.append(f"exit status {done.status}, expected {status}: {done.err.strip()[-300:]}")
    if "Traceback" in done.out + done.err:
        faults.append("a traceback is shown")
    return faults


def check_values(value: Value, done: Done) -> list[str]:
    """Faults of an answer in JSON."""
    faults = check_frame(done, 0)
    try:
        record = json.loads(done.out, parse_constant=refuse_constant)
    except ValueError as error:
        return [*faults, f"stdout is not one JSON object: {error}"]
    for path, wanted, tolerance in value.expected:
        found = find(record, path)
        if not agrees(found, wanted, tolerance):
            faults.append(f"{path} is {found!r}, expected {wanted!r} within {tolerance:g}")
    faults += [f"{path} is there, and should be absent" for path in value.absent if find(record, path) is not None]
    return faults


def check_refusal(case: Refusal, done: Done) -> list[str]:
    """Faults of an answer to input that must be refused: status, words, nothing on stdout."""
    faults = check_frame(done, case.status)
    if done.out:
        faults.append(f"stdout holds {done.out[:80]!r}")
    text = " ".join(done.err.split())
    faults += [f"the message does not say {word!r}: {text[:300]!r}" for word in case.words if word not in text]
    return faults


class Checker:
    """Runs commands in a folder and counts what holds."""

    def __init__(self, program: list[str], folder: Path, *, self_test: bool) -> None:
        self.program, self.folder, self.self_test = program, folder, self_test
        self.passed = 0
        self.failures: list[str] = []
        self.counting = threading.Lock()

    def run(self, arguments: tuple[str, ...]) -> Done:
        command = [*self.program, *arguments]
        with RUNNING:
            done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False, timeout=LONGEST)
        return Done(done.returncode, done.stdout, done.stderr)

    def record(self, title: str, faults: list[str]) -> None:
        with self.counting:
            self.passed += not faults
            self.failures += [f"{title}: {fault}" for fault in faults]

    def take(self, title: str, step: Callable[[], None]) -> None:
        """Let a step record what it finds, and whatever it meets."""
        try:
            step()
        except Exception as error:  # noqa: BLE001 - a checker reports, whatever it met
            self.record(title, [f"could not be checked: {error!r}"])

    def must_fail(self, title: str, what: str, faults: list[str]) -> None:
        """Count an altered answer: it must have faults."""
        self.record(title, [] if faults else [f"self-test: {what} was not noticed"])

    def try_value(self, value: Value) -> None:
        title = " ".join(("revline", *value.arguments))
        done = self.run(value.arguments)
        faults = check_values(value, done)
        self.record(title, faults)
        if not self.self_test or faults:
            return
        record = json.loads(done.out)
        for path, _, tolerance in value.expected:
            altered = done._replace(out=json.dumps(move(record, path, tolerance)))
            self.must_fail(title, f"an altered {path}", check_values(value, altered))
        for what, altered in (
            ("a wrong exit status", done._replace(status=1)),
            ("a traceback", done._replace(err="Traceback (most recent call last):")),
            ("NaN", done._replace(out=json.dumps({**record, "planted": math.nan}))),
            ("text beside the JSON", done._replace(out=f"{done.out}\nwritten")),
            ("an empty answer", done._replace(out="")),
        ):
            self.must_fail(title, what, check_values(value, altered))
        for path in value.absent:
            self.must_fail(
                title, f"a planted {path}", check_values(value, done._replace(out=json.dumps({**record, path.split(".")[0]: 1.0})))
            )

    def try_refusal(self, case: Refusal) -> None:
        title = " ".join(("revline", *case.arguments))
        done = self.run(case.arguments)
        faults = check_refusal(case, done)
        self.record(title, faults)
        if not self.self_test or faults:
            return
        for what, altered in (
            ("success", done._replace(status=0)),
            ("the other failure", done._replace(status=3 - case.status)),
            ("a traceback", done._replace(err=f"{done.err}\nTraceback (most recent call last):")),
            ("output", done._replace(out="{}")),
            ("a message that says nothing", done._replace(err="error: no\n")),
        ):
            self.must_fail(title, what, check_refusal(case, altered))


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file, its comment lines left out."""
    with path.open() as handle:
        return list(csv.DictReader(line for line in handle if not line.startswith("#")))


def check_files(checker: Checker) -> None:
    """The files that the commands of 10_basics.toml wrote hold what they said."""
    folder = checker.folder
    faults = []
    rows = read_rows(folder / "map.csv")
    speeds = {float(row["throttle_deg"]): float(row["speed_rad_s"]) for row in rows}
    for angle, speed in {10.0: 64.467, 15.0: 121.238, 20.0: 180.676, 30.0: 300.778, 40.0: 418.614, 50.0: 531.854, 60.0: 638.934}.items():
        if abs(speeds.get(angle, math.nan) - speed) > 2e-3 or angle not in speeds:
            faults.append(f"map.csv has {speeds.get(angle)} rad/s at {angle} deg, not {speed}")
    stable = {float(row["throttle_deg"]): row["stable"] for row in rows}
    if [stable.get(angle) for angle in (4.0, 5.0, 6.0, 7.0)] != ["0", "0", "1", "1"]:
        faults.append(f"map.csv: stable is {stable}")
    loop = read_rows(folder / "hunting.csv")
    for row in loop[:: max(1, len(loop) // 200)]:
        wanted = 25.0 + sum(float(row[f"{term}_deg"]) for term in ("proportional", "integral", "derivative"))
        if abs(float(row["throttle_deg"]) - min(max(wanted, 0.0), 79.46)) > 1e-9:
            faults.append(f"hunting.csv: the throttle at {row['time_s']} s is not the limited sum of its terms")
    whole, first, later = (read_rows(folder / f"{name}.csv") for name in ("whole", "run", "later"))
    if whole != first + later:
        faults.append("a run that was continued is not, digit for digit, the run that did not stop")
    checker.record("files written", faults)


def check_left(checker: Checker) -> None:
    """No command left a file that it should not."""
    faults = [f"a refused command left {path.name}" for path in checker.folder.glob("refused*")]
    faults += [f"a part of a file is left: {path.name}" for path in checker.folder.rglob("*.part")]
    checker.record(f"files left in {checker.folder.name}", faults)


def interrupt_study(checker: Checker, out: Path) -> Done:
    """Begin the study, interrupt it as Ctrl-C does once a step is finished, and wait for its end."""
    command = [*checker.program, "study", "--out", str(out)]
    with RUNNING, subprocess.Popen(command, cwd=checker.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        ends = time.monotonic() + LONGEST
        while not has_finished(out / "results.json", "operating-point"):
            if running.poll() is not None or time.monotonic() > ends:
                break
            time.sleep(0.02)
        running.send_signal(signal.SIGINT)
        told, warned = running.communicate(timeout=LONGEST)
    return Done(running.returncode, told, warned)


def has_finished(results: Path, step: str) -> bool:
    """Whether a study under way says that it has finished a step; its file is replaced as a whole."""
    return results.is_file() and step in json.loads(results.read_text()).get("finished_steps", ())


def check_partial(done: Done, results: str) -> list[str]:
    """Faults of an interrupted study: it must end with 1, say that it is partial and how to go on, and leave that in its results."""
    faults = check_frame(done, 1)
    text = " ".join(done.err.split())
    faults += [
        f"the message does not say {word!r}: {text[-300:]!r}" for word in ("partial", "run the same command again") if word not in text
    ]
    record = json.loads(results, parse_constant=refuse_constant)
    if record.get("partial") is not True or "operating-point" not in record.get("finished_steps", ()):
        faults.append(f"results.json does not say that it is partial: {sorted(record)}")
    return faults


def check_study_command(checker: Checker) -> None:
    """A study that was interrupted says so, goes on to the whole study, and its report comes out again byte for byte."""
    out = checker.folder / "study"
    done = interrupt_study(checker, out)
    partial = (out / "results.json").read_text()
    faults = check_partial(done, partial)
    checker.record("revline study, interrupted", faults)
    if checker.self_test and not faults:
        checker.must_fail("revline study, interrupted", "success", check_partial(done._replace(status=0), partial))
        checker.must_fail("revline study, interrupted", "silence", check_partial(done._replace(err=""), partial))
        checker.must_fail("revline study, interrupted", "no mark of being partial", check_partial(done, "{}"))
    refused = checker.run(("report", "study"))
    checker.record("revline report on a partial study", check_refusal(Refusal((), 2, ("holds no finished study",)), refused))
    whole = checker.run(("study", "--out", "study", "--json"))
    faults = check_frame(whole, 0)
    if json.loads(whole.out, parse_constant=refuse_constant) != json.loads((out / "results.json").read_text()):
        faults.append("what --json prints is not results.json")
    checker.record("revline study, continued", faults)
    same = Value(("compare", "study", "study", "--json"), (("same", True, 0.0), ("only_first", [], 0.0)), ())
    checker.try_value(same)
    judged = subprocess.run([sys.executable, HERE / "check_study.py", out], capture_output=True, text=True, check=False)
    checker.record("check_study.py", [judged.stdout[-500:]] if judged.returncode else [])
    page = (out / "report.html").read_bytes()
    (out / "report.html").unlink()
    checker.record("revline report study", check_frame(checker.run(("report", "study", "--quiet")), 0))
    checker.record("the report again", [] if (out / "report.html").read_bytes() == page else ["it is not the same, byte for byte"])


def check_help(checker: Checker, tried: frozenset[str]) -> None:
    """Each command that the help lists explains itself, with an example; none is listed that does not run."""
    listing = checker.run(("--help",))
    checker.record("revline --help", check_frame(listing, 0))
    names = [line.split()[0] for line in listing.out.partition("Commands:")[2].splitlines() if line.startswith("  ") and line[2] != " "]
    checker.record("commands tried", [f"{name} is listed and not tried here" for name in names if name not in tried | ELSEWHERE])
    for name in names:
        done = checker.run((name, "--help"))
        faults = check_frame(done, 0)
        if f"Example: revline {name}" not in " ".join(done.out.split()):
            faults.append("there is no example")
        checker.record(f"revline {name} --help", faults)


def read_cases(path: Path) -> dict[str, Any]:
    """What a file asks for."""
    return {"value": [], "refusal": [], "engines": {}, "files": {}, **tomllib.loads(path.read_text())}


def read_values(cases: dict[str, Any]) -> list[Value]:
    """Commands that must succeed, in their order."""
    return [
        Value((*case["command"].split(), "--json"), tuple(tuple(entry) for entry in case["expected"]), tuple(case.get("absent", ())))
        for case in cases["value"]
    ]


def read_refusals(cases: dict[str, Any]) -> list[Refusal]:
    """Commands that must fail."""
    return [Refusal(tuple(case["command"].split()), case["status"], tuple(case["words"])) for case in cases["refusal"]]


def prepare_files(folder: Path, cases: dict[str, Any], engine: str) -> None:
    """Write the files that the commands are given."""
    for name, text in cases["files"].items():
        (folder / name).write_text(text)
    for name, changes in cases["engines"].items():
        text = engine
        for old, new in zip(changes[::2], changes[1::2], strict=True):
            if old not in text:
                message = f"the printed engine file has no {old!r}"
                raise ValueError(message)
            text = text.replace(old, new)
        (folder / f"{name}.toml").write_text(text)
    (folder / "table.csv").write_text(TABLE.read_text())
    header, _, rest = TABLE.read_text().partition("\n")
    renamed = header.replace("frequency_rad_s", "w").replace("speed_amplitude_rad_s", "a").replace("phase_lag_deg", "lag")
    (folder / "renamed.csv").write_text(f"{renamed}\n{rest}")


def find_program(given: list[str]) -> list[str]:
    """The program to try."""
    beside = Path(sys.executable).with_name("revline")
    found = given[0] if given else str(beside) if beside.exists() else shutil.which("revline")
    if not found:
        message = "there is no revline beside this Python or on the path; give its path"
        raise SystemExit(message)
    return [str(Path(found).absolute())] if Path(found).exists() else [found]


def check_cases(checker: Checker, cases: dict[str, Any], engine: str) -> None:
    """Try what one file asks for, each command even where one before it failed; refusals once all files are made."""
    prepare_files(checker.folder, cases, engine)
    values, refusals = read_values(cases), read_refusals(cases)
    asked = [case.arguments for case in values] + [case.arguments for case in refusals]
    made = frozenset[str]().union(*map(files_written, asked))
    given = frozenset(path.name for path in checker.folder.iterdir()) - made

    def run_all(cases: Sequence[Any], attempt: Callable[[Any], None]) -> None:
        steps = [partial(checker.take, str(case), partial(attempt, case)) for case in cases]
        run_in_order(list(zip((files_named(case.arguments, given) for case in cases), steps, strict=True)))

    run_all(values, checker.try_value)
    run_all(refusals, checker.try_refusal)
    if checker.folder.name == "10_basics":
        checker.take("files written", partial(check_files, checker))
    checker.take("files left", partial(check_left, checker))


def main(arguments: list[str]) -> int:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that starts this in the background has it ignored, by children too
    program = find_program([argument for argument in arguments if not argument.startswith("--")])
    only = next((argument.removeprefix("--only=") for argument in arguments if argument.startswith("--only=")), "*")
    cases = {path.stem: read_cases(path) for path in sorted((HERE / "commands").glob(f"{only}.toml"))}
    if not cases:
        raise SystemExit(f"there is no commands/{only}.toml to try")
    with tempfile.TemporaryDirectory(prefix="revline-") as name, ThreadPoolExecutor(len(cases) + 2) as pool:
        start = partial(Checker, program, self_test="--self-test" in arguments)
        checkers = [start(Path(name))]
        engine = checkers[0].run(("engines", "lee1995"))
        checkers[0].record("revline engines lee1995", check_frame(engine, 0))
        jobs: dict[str, Callable[[Checker], None]] = {
            key: partial(check_cases, cases=asked, engine=engine.out) for key, asked in cases.items()
        }
        if only == "*":
            tried = frozenset(value.arguments[0] for asked in cases.values() for value in read_values(asked))
            jobs = {"study_command": check_study_command, "help": partial(check_help, tried=tried), **jobs}
        running = []
        for key, job in jobs.items():  # each in a thread of its own; RUNNING limits their commands
            checkers.append(start(Path(name) / key))
            checkers[-1].folder.mkdir()
            running.append(pool.submit(checkers[-1].take, key, partial(job, checkers[-1])))
        _ = [ended.result() for ended in running]
    failures = [failure for checker in checkers for failure in checker.failures]
    print("\n".join([*failures, f"{sum(checker.passed for checker in checkers)} passed, {len(failures)} failed"]))
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
