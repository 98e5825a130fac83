#!/usr/bin/env python3
"""Try `revline serve` as a program would: start it, ask for known values, attack it, stop it.

Usage: check_serve.py [REVLINE] [--self-test]. REVLINE is the program, by default the `revline` beside this Python or on the path.
Exits 0 when all hold, prints each line that falls short, then 'N passed, M failed'. With --self-test wrong values are expected on purpose,
and one that passes counts as a failure. Standard library only.
Values: K. Lee, MSc thesis, University of Southern California, 1995, and converged computations.
"""

import json
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any, NamedTuple

from json_values import agrees, find

C1 = {"kp": 2.15361, "ki": 16.8546, "kd": 0.0, "command_rad_s": 60.0}


class Case(NamedTuple):
    """A question, the status of its answer, and what its JSON must hold: path, value, tolerance."""

    path: str
    body: Any
    status: int
    expected: tuple[tuple[str, Any, float], ...]
    headers: tuple[tuple[str, str], ...] = ()


CASES = (
    Case("view", {"parts": ["point"]}, 200, (("parts.point.speed_rad_s", 240.799, 1e-3), ("parts.point.stable", True, 0.0))),
    Case("view", {"parts": ["margins"]}, 200, (("parts.margins.gain_margin", 1.501042, 1e-5), ("parts.margins.stable", True, 0.0))),
    Case("view", {"state": C1, "parts": ["loop"]}, 200, (("parts.loop.limit_cycle.period_s", 0.2088, 5e-4),)),
    Case("trim", {"throttle_deg": 25}, 200, (("speed_rad_s", 240.799, 1e-3),)),
    Case("view", {"state": {"kp": 1e9}}, 422, (("control", "kp", 0.0), ("exit_status", 2, 0.0))),
    Case("view", {"state": {"throttle_deg": 2.0}, "parts": ["point"]}, 200, (("parts.point.problem.exit_status", 1, 0.0),)),
    Case("view", {}, 421, (("type", "/problems/wrong-host", 0.0),), (("Host", "evil.example"),)),
    Case("view", {}, 403, (("type", "/problems/wrong-origin", 0.0),), (("Origin", "https://evil.example"),)),
    Case("view", {}, 415, (("type", "/problems/wrong-kind", 0.0),), (("Content-Type", "text/plain"),)),
    Case("nowhere", {}, 405, (("type", "/problems/method-not-allowed", 0.0),)),
)


def ask(link: str, case: Case) -> tuple[int, Any]:
    """Status and JSON of the answer."""
    headers = {"Content-Type": "application/json", **dict(case.headers)}
    request = urllib.request.Request(f"{link}api/v1/{case.path}", json.dumps(case.body).encode(), headers)  # noqa: S310 - our own server
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:  # noqa: S310 - our own server
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def faults_of(case: Case, status: int, record: Any) -> list[str]:
    """What falls short of a case."""
    found = [] if status == case.status else [f"status {status}, expected {case.status}"]
    for path, value, tolerance in case.expected:
        try:
            got = find(record, path)
        except (KeyError, IndexError, TypeError):
            found.append(f"{path} is missing")
            continue
        if not agrees(got, value, tolerance):
            found.append(f"{path} is {got}, expected {value}")
    return found


def planted(case: Case) -> Case:
    """The same with a wrong value expected."""
    path, value, tolerance = case.expected[0]
    wrong = not value if isinstance(value, bool) else f"{value}x" if isinstance(value, str) else value * 1.1 + 1.0
    return case._replace(expected=((path, wrong, tolerance),))


def run(link: str, *, self_test: bool) -> list[list[str]]:
    """Try all cases: what falls short of each."""
    results = []
    for case in CASES:
        status, record = ask(link, case)
        results.append([f"{case.path} {case.body}: {fault}" for fault in faults_of(case, status, record)])
        if self_test:
            missed = not faults_of(planted(case), status, record)
            results.append([f"{case.path} {case.body}: a planted wrong value passes"] if missed else [])
    return results


def main() -> int:
    """Start the server, try it, stop it."""
    given = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    beside = Path(sys.executable).with_name("revline")
    program = given[0] if given else str(beside) if beside.exists() else shutil.which("revline") or "revline"
    server = subprocess.Popen(
        [program, "serve", "--no-browser", "--port", "0", "--json", "-q"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        lines = ""
        while "}" not in lines and server.stdout is not None and (line := server.stdout.readline()):
            lines += line
        results = run(json.loads(lines)["link"], self_test="--self-test" in sys.argv)
    finally:
        server.send_signal(signal.SIGTERM)
        _, said = server.communicate(timeout=30)
    results.append(["a traceback is shown at the end"] if "Traceback" in said else [])
    failed = [fault for faults in results for fault in faults]
    for fault in failed:
        sys.stdout.write(f"FAILED {fault}\n")
    sys.stdout.write(f"{sum(not faults for faults in results)} passed, {sum(bool(faults) for faults in results)} failed\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
