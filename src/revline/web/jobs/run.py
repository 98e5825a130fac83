"""The process of one job: started with the job's folder as its argument. It says how far it is, and how it ended."""

import fcntl
import os
import signal
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import Any, Final

from revline.errors import PartialResultError, RevlineError
from revline.io.json_files import read_json, write_json
from revline.web.jobs.folder import END, JOB, LOG, OUT, PROGRESS, QUESTIONS, STATE, Kind, Status
from revline.web.problems import make_problem, problem_of

OFTEN: Final = 0.5
"""Seconds between two notes of how far a job is, at least."""

LOCK: Final = ".running"
STREAM: Final = "sinestream"
Tell = Callable[[str, float], None]


class Teller:
    """Notes how far a job is, at most so often.

    Args:
        folder: of the job.
    """

    def __init__(self, folder: Path) -> None:
        self._path, self._began, self._last = folder / PROGRESS, time.time(), -OFTEN

    def tell(self, stage: str, done: float) -> None:
        """Note the stage under way and the part done, 0 to 1."""
        now = time.monotonic()
        if now - self._last < OFTEN:
            return
        self._last = now
        record = {"stage": stage, "done": min(max(float(done), 0.0), 1.0), "began": self._began, "told": time.time()}
        write_json(self._path, record, "progress")


def run_study_job(folder: Path, tell: Tell) -> None:
    """Run the study of a job's study file; one that was interrupted goes on from its finished steps."""
    from revline.studies.config import read_config  # noqa: PLC0415 - a sinestream needs none of it
    from revline.studies.writing import run_study  # noqa: PLC0415 - a sinestream needs none of it

    run_study(read_config(folder / QUESTIONS), folder / OUT, tell)


def run_sinestream_job(folder: Path, tell: Tell) -> None:
    """Simulate sinusoids at the frequencies of Lee (1995), Table 4.1, each until it has settled, and read their peaks."""
    import numpy as np  # noqa: PLC0415 - read the folder first: it may be refused

    from revline.analysis.cycle_readings import ReadingMethod  # noqa: PLC0415 - as above
    from revline.analysis.periodic import Excitation  # noqa: PLC0415 - as above
    from revline.analysis.sinestream import PartialSinestream, attempt_sinestream  # noqa: PLC0415 - as above
    from revline.io.atomic import write_atomically  # noqa: PLC0415 - as above
    from revline.io.response_files import format_response, response_rows  # noqa: PLC0415 - as above
    from revline.studies.config import read_table_4_1  # noqa: PLC0415 - as above
    from revline.web.plants import check_amplitude, find_point, place_of  # noqa: PLC0415 - as above
    from revline.web.state import parse_state  # noqa: PLC0415 - as above

    state = parse_state(read_json(folder / STATE, "state").entries)
    point = find_point(place_of(state))
    check_amplitude(state, point)
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=state.amplitude_deg)
    omega = np.array([row["frequency_rad_s"] for row in read_table_4_1()])
    found = attempt_sinestream(point.engine, point.trim, excitation, omega, workers=2, progress=lambda done: tell("sinusoids", done))
    partial = isinstance(found, PartialSinestream)
    stream = found.finished if isinstance(found, PartialSinestream) else found
    response, amplitude = stream.response(ReadingMethod.PEAKS), state.amplitude_deg
    missing = str(found) if partial else ""
    text = format_response(response, amplitude=amplitude, distortion=stream.distortion, partial=missing)
    out = folder / OUT
    out.mkdir(exist_ok=True)
    write_atomically(out / f"{STREAM}.csv", text, "frequency response")
    rows = response_rows(response, amplitude=amplitude, distortion=stream.distortion)
    record: dict[str, Any] = {"method": "peaks", "throttle_deg": point.trim.input("throttle"), "amplitude_deg": amplitude}
    record |= {"frequency_response": rows, "notes": list(stream.reading(ReadingMethod.PEAKS).notes)}
    write_json(out / f"{STREAM}.json", {**record, "missing": missing} if partial else record, "frequency response")


KINDS: Final[Mapping[Kind, Callable[[Path, Tell], None]]] = MappingProxyType(
    {Kind.STUDY: run_study_job, Kind.SINESTREAM: run_sinestream_job}
)


def run_job(folder: Path, tell: Tell) -> None:
    """Do a job's work, and note how it ended; one that was stopped from outside has no end, and can go on.

    Args:
        folder: of the job.
        tell: told the stage under way and the part done.
    """
    try:
        KINDS[Kind(read_json(folder / JOB, "job").text("kind", ""))](folder, tell)
    except KeyboardInterrupt:
        return
    except RevlineError as error:
        stopped = isinstance(error, PartialResultError) and isinstance(error.__cause__, KeyboardInterrupt)
        if not stopped:
            write_json(folder / END, {"status": Status.FAILED.value, "error": problem_of(error)}, "end of the job")
        return
    except Exception as error:  # noqa: BLE001 - the last resort says where to look
        if _interrupted(error):
            return
        traceback.print_exc()
        fault = make_problem("fault", "a fault in revline", f"this is a fault in revline; {folder / LOG} says more", status=500)
        write_json(folder / END, {"status": Status.FAILED.value, "error": fault}, "end of the job")
        return
    write_json(folder / END, {"status": Status.DONE.value}, "end of the job")


def _interrupted(error: BaseException | None) -> bool:
    """Whether an interruption is behind an error: Python makes another of it where it falls into the making of a class."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def main(arguments: list[str]) -> int:
    """Run the job of a folder, unless another process is at it."""
    folder = Path(arguments[0]).absolute()
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        teller = Teller(folder)
        teller.tell("starting", 0.0)
        run_job(folder, teller.tell)
    except (BlockingIOError, KeyboardInterrupt):
        return 1
    finally:
        os.close(file)
    return 0


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Take a wish to end as Ctrl-C: what is finished is kept. A second one changes nothing."""
    del frame
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt
