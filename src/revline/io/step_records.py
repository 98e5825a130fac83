"""Step responses of linear models as CSV and as records."""

from collections.abc import Mapping

from numpy.typing import ArrayLike

from revline.io.csv_text import format_csv
from revline.io.headers import header
from revline.lti.time_response import TimeResponse

STEP_INTERVALS = 1000
"""Intervals between the samples that a file holds."""


def format_step(found: TimeResponse) -> str:
    """Format a response as CSV: time, and a column for each output, its unit in the header.

    Args:
        found: of any linear system.
    """
    columns: list[tuple[str, ArrayLike]] = [("time_s", found.times)]
    columns += [(header(signal.name, signal.unit), found.output(signal.name)) for signal in found.outputs]
    return format_csv(columns, notes={"input": found.input.name, "input_unit": found.input.unit, "kind": found.kind})


def step_record(found: TimeResponse) -> Mapping[str, object]:
    """Give what a response ends in, its jumps and its estimated errors as a record.

    Args:
        found: of any linear system.
    """
    return {
        "input": found.input.name,
        "until_s": float(found.times[-1]),
        "final": {signal.name: float(found.output(signal.name)[-1]) for signal in found.outputs},
        "errors": {signal.name: float(error) for signal, error in zip(found.outputs, found.errors, strict=True)},
        "jumps_s": [jump.time for jump in found.jumps],
        "pieces": found.pieces,
    }
