"""Long work: jobs run in processes that outlive the server, stand in a queue, change under revisions, and give only their own results."""

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from revline.errors import InvalidInputError, PartialResultError
from revline.io.json_files import format_json, read_json
from revline.io.response_files import read_response
from revline.web.jobs import run as job_process
from revline.web.jobs.folder import END, ENGINE, JOB, OUT, PROGRESS, QUESTIONS, STATE, Kind, Note, read_note, write_note
from revline.web.jobs.processes import Identity, has_ended, identify, lives, send
from revline.web.jobs.queue import KEPT, WAITING, JobError, Jobs
from revline.web.plants import find_point, place_of
from revline.web.state import State

STUDY = {STATE: "{}", QUESTIONS: 'schema = "revline.study-file/1"\n[study]\nthrottle_deg = 25.0\n', ENGINE: ""}
STREAM = {STATE: format_json({"throttle_deg": 25.0, "amplitude_deg": 2.0})}


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    made = Jobs(tmp_path)
    yield made
    for note in (read_note(folder) for folder in (tmp_path / "jobs").glob("2*")):
        if note.process is not None:
            send(note.process, signal.SIGKILL)
            while not has_ended(note.process.pid):  # not tend(), which would start what waits
                time.sleep(0.01)


def wait(jobs: Jobs, name: str, wanted: Callable[[dict[str, Any]], bool], seconds: float = 120.0) -> dict[str, Any]:
    ends = time.monotonic() + seconds
    while True:
        jobs.tend()
        record = jobs.record(name)
        if wanted(record):
            return record
        assert time.monotonic() < ends, record
        time.sleep(0.05)


def is_at_work(record: dict[str, Any]) -> bool:
    return record["status"] == "running" and record["progress"] > 0.0


@pytest.mark.slow
def test_a_job_outlives_its_server_and_its_result_is_the_response(jobs: Jobs, tmp_path: Path) -> None:
    made = jobs.create(Kind.SINESTREAM, STREAM)
    assert (made["status"], made["revision"], made["files"]) == ("running", 2, [])
    after = Jobs(tmp_path)  # what a server that was started anew knows
    assert after.record(made["id"])["status"] == "running"
    done = wait(after, made["id"], lambda record: record["status"] != "running")
    assert (done["status"], done["progress"], done["files"]) == ("done", 1.0, ["sinestream.csv", "sinestream.json"])
    assert done["state"]["amplitude_deg"] == 2.0
    response = read_response(after.file(made["id"], "sinestream.csv")).response
    assert len(response.omega) == 42
    exact = find_point(place_of(State(throttle_deg=25.0))).linear.model.response(response.omega, "throttle", "engine_speed")
    assert np.max(np.abs(response.magnitude_db - exact.magnitude_db)) < 0.2
    with pytest.raises(JobError, match="is done; only a job that waits or runs can be cancelled"):
        after.cancel(made["id"], done["revision"])
    after.delete(made["id"], done["revision"])
    assert after.records() == {"jobs": [], "warnings": []}
    assert not list((tmp_path / "jobs").glob("*2*"))


@pytest.mark.slow
def test_a_study_is_interrupted_goes_on_and_is_cancelled_and_the_next_job_waits(jobs: Jobs, tmp_path: Path) -> None:
    first = jobs.create(Kind.STUDY, STUDY)["id"]
    second = jobs.create(Kind.STUDY, STUDY)
    assert second["status"] == "queued"
    running = wait(jobs, first, is_at_work)
    process = read_note(tmp_path / "jobs" / first).process
    assert process is not None
    stopped = jobs.cancel(second["id"], second["revision"])
    assert stopped["status"] == "cancelled"
    send(process, signal.SIGKILL)  # as when the machine loses power
    wait(jobs, first, lambda record: record["status"] == "interrupted")
    resumed = jobs.resume(first, running["revision"])
    assert resumed["status"] == "running"
    wait(jobs, first, lambda record: is_at_work(record) and record["files"] != [])
    cancelled = jobs.cancel(first, resumed["revision"])
    assert cancelled["revision"] == resumed["revision"] + 1
    gone = wait(jobs, first, lambda record: record["status"] == "cancelled", 20.0)
    assert "results.json" in gone["files"]  # what is finished is kept, and says that it is partial
    assert json.loads(jobs.file(first, "results.json").read_text())["partial"] is True


def test_the_queue_is_limited_and_says_so(jobs: Jobs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Jobs, "_start_next", lambda _: None)
    names = [jobs.create(Kind.STUDY, STUDY)["id"] for _ in range(WAITING)]
    assert len(set(names)) == WAITING
    with pytest.raises(JobError, match=f"{WAITING} jobs wait already, at most {WAITING} may; cancel one") as caught:
        jobs.create(Kind.STUDY, STUDY)
    assert caught.value.problem["status"] == HTTPStatus.TOO_MANY_REQUESTS
    monkeypatch.setattr("revline.web.jobs.queue.WAITING", KEPT + 1)
    monkeypatch.setattr("revline.web.jobs.queue.KEPT", WAITING)
    with pytest.raises(JobError, match=f"{WAITING} jobs are kept, at most {WAITING} may be; delete some") as caught:
        jobs.create(Kind.STUDY, STUDY)
    assert caught.value.problem["status"] == HTTPStatus.INSUFFICIENT_STORAGE


def test_of_two_pages_that_change_a_job_the_later_one_is_told(jobs: Jobs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Jobs, "_start_next", lambda _: None)
    made = jobs.create(Kind.STUDY, STUDY)
    with pytest.raises(JobError, match="is queued; cancel it first"):
        jobs.delete(made["id"], made["revision"])
    with pytest.raises(JobError, match="is queued; only one that was interrupted or cancelled can go on"):
        jobs.resume(made["id"], made["revision"])
    outcomes: list[str] = []

    def cancel() -> None:
        try:
            outcomes.append(jobs.cancel(made["id"], made["revision"])["status"])
        except JobError as error:
            outcomes.append(str(error.problem["status"]))

    pages = [threading.Thread(target=cancel) for _ in range(8)]
    for page in pages:
        page.start()
    for page in pages:
        page.join()
    assert sorted(outcomes) == ["412"] * 7 + ["cancelled"]
    with pytest.raises(
        JobError, match="was changed meanwhile, perhaps from another page: its revision is 2, and the request was made for 1"
    ):
        jobs.delete(made["id"], 1)


@pytest.mark.parametrize("name", ["..", ".", "../x", "20260101T000000-00000000", "a/b", "", "20260101T000000-0000000g"])
def test_a_name_that_is_no_jobs_is_refused(jobs: Jobs, name: str) -> None:
    with pytest.raises(JobError, match="there is no job"):
        jobs.record(name)


def test_only_results_are_given_and_no_link_leads_out(jobs: Jobs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Jobs, "_start_next", lambda _: None)
    name = jobs.create(Kind.STUDY, STUDY)["id"]
    out = tmp_path / "jobs" / name / OUT
    (out / "steps").mkdir(parents=True)
    (tmp_path / "secret.json").write_text("{}")
    for file in ("report.html", "steps/point.json", ".hidden.json", "code.py"):
        (out / file).write_text("x")
    (out / "link.json").symlink_to(tmp_path / "secret.json")
    (out / "up").symlink_to(tmp_path)
    assert jobs.record(name)["files"] == ["report.html"]
    for file in ("link.json", "up/secret.json", "../job.json", "steps/point.json", "/etc/passwd", "", "report.html/"):
        with pytest.raises(JobError, match="has no result"):
            jobs.file(name, file)


def test_another_process_with_the_same_number_is_not_taken_for_the_job_s(jobs: Jobs, tmp_path: Path) -> None:
    own = identify(os.getpid())
    assert own is not None
    assert lives(own)
    other = own._replace(start=own.start - 1)
    assert not lives(other)
    send(other, signal.SIGKILL)  # were it sent, this test would not end
    assert identify(2**22 + 1) is None
    folder = tmp_path / "jobs" / "20260101T000000-00000000"
    folder.mkdir(parents=True)
    note = Note(name=folder.name, kind=Kind.STUDY, created="2026-01-01T00:00:00Z", revision=3, queued=1.0, process=other)
    write_note(folder, note)
    assert read_note(folder) == note
    assert jobs.record(folder.name)["status"] == "interrupted"
    write_note(folder, Note(name=folder.name, kind=Kind.STUDY, created="now", revision=3, queued=1.0, process=Identity(*own)))
    assert jobs.record(folder.name)["status"] == "running"
    (folder / JOB).write_text("{")
    (damaged,) = jobs.records()["warnings"]
    assert "no JSON" in damaged
    (folder / JOB).write_text('{"kind": "dance", "created": "now", "revision": 1, "queued": 0, "cancelled": 0}')
    with pytest.raises(InvalidInputError, match=r"is damaged: 'dance' is not a valid Kind; remove its folder"):
        read_note(folder)
    folder.rename(folder.with_name("kept aside"))


@pytest.mark.parametrize(
    ("error", "words"),
    [(InvalidInputError("planted", value=1.0), "planted"), (RuntimeError("planted"), "a fault in revline")],
)
def test_a_job_that_fails_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str) -> None:
    (tmp_path / JOB).write_text('{"kind": "study"}')

    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(job_process, "KINDS", {Kind.STUDY: fail})
    job_process.run_job(tmp_path, lambda _, __: None)
    end = read_json(tmp_path / END, "end").entries
    assert end["status"] == "failed"
    assert words in end["error"]["detail"]


def test_a_job_that_is_stopped_while_a_class_is_made_has_no_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As when a library is imported; Python 3.11 makes a RuntimeError of it."""
    (tmp_path / JOB).write_text('{"kind": "study"}')

    class Stops:
        def __set_name__(self, owner: type, name: str) -> None:
            raise KeyboardInterrupt

    monkeypatch.setattr(job_process, "KINDS", {Kind.STUDY: lambda *_: type("Made", (), {"part": Stops()})})
    job_process.run_job(tmp_path, lambda _, __: None)
    assert not (tmp_path / END).exists()


def test_a_job_that_is_stopped_has_no_end_and_one_process_alone_works_on_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / JOB).write_text('{"kind": "study"}')

    def stop(*_: object) -> None:
        message = "interrupted"
        raise PartialResultError(message) from KeyboardInterrupt()

    def nest(folder: Path, tell: Callable[[str, float], None]) -> None:
        tell("within", 0.5)
        assert job_process.main([str(folder)]) == 1

    before = [(number, signal.getsignal(number)) for number in (signal.SIGTERM, signal.SIGINT)]
    try:
        monkeypatch.setattr(job_process, "KINDS", {Kind.STUDY: stop})
        assert job_process.main([str(tmp_path)]) == 0
        assert not (tmp_path / END).exists()
        monkeypatch.setattr(job_process, "KINDS", {Kind.STUDY: nest})
        assert job_process.main([str(tmp_path)]) == 0
    finally:
        for number, handler in before:
            signal.signal(number, handler)
    assert read_json(tmp_path / END, "end").text("status", "") == "done"
    assert read_json(tmp_path / PROGRESS, "progress").text("stage", "") == "starting"


def test_a_data_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    jobs = Jobs(tmp_path / "file")
    assert jobs.records()["jobs"] == []
    jobs.tend()
    with pytest.raises(InvalidInputError, match=r"the data folder .* cannot be written: Not a directory; name another with --data"):
        jobs.create(Kind.STUDY, STUDY)
