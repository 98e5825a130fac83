import threading
import time
from functools import partial

from side_by_side import files_named, run_in_order


def test_a_command_names_what_it_reads_and_writes_but_not_what_it_was_given() -> None:
    command = "fit table.csv --engine=lee.toml --input file:run.csv+step:5@0.5 --at 0.5,1.5 --delay -0.02 --out made --plot here/plot.svg"
    assert files_named(command.split(), frozenset({"table.csv"})) == {
        "lee.toml",
        "run.csv",
        "made",
        "here/plot.svg",
        "here",
    }


def test_steps_with_a_name_in_common_keep_their_order_and_others_run_side_by_side() -> None:
    seen: list[str] = []
    meeting = threading.Barrier(2)

    def write(name: str, seconds: float) -> None:
        time.sleep(seconds)
        seen.append(name)

    def meet() -> None:
        meeting.wait(timeout=10.0)  # ends only if another step is under way at the same time

    one, other = frozenset({"one.json", "two.json"}), frozenset({"two.json", "three.json"})
    nothing = frozenset[str]()
    run_in_order(
        [
            (one, partial(write, "first", 0.1)),
            (nothing, meet),
            (other, partial(write, "second", 0.0)),
            (nothing, meet),
            (frozenset({"three.json"}), partial(write, "third", 0.0)),
        ]
    )
    assert seen == ["first", "second", "third"]
