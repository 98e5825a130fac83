"""What a simulation gives: samples, and the stopped run from which it goes on."""

from dataclasses import dataclass

import numpy as np

from revline.dde import run as runs
from revline.dde.kernel import Method
from revline.dde.run import Floats
from revline.errors import InvalidInputError
from revline.values import make_read_only

MARGIN_NODES = 8
"""Nodes kept before the one that a channel reads: more than a cubic needs to its left."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A run's state (an array of one record, see `revline.dde.run.state_type`) and its history."""

    state: np.ndarray
    nodes: Floats
    segments: Floats

    def copy(self) -> "Run":
        """Copy all arrays, so that a checkpoint stays what it was."""
        return Run(self.state.copy(), self.nodes.copy(), self.segments.copy())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Checkpoint:
    """A stopped run: all arrays of its state, the method, and digests of the system and the signals that it ran with."""

    system_digest: str
    signal_digest: str
    method: Method
    run: Run

    @property
    def time(self) -> float:
        """When the run stopped, in seconds."""
        return float(self.run.state["time"][0])

    @property
    def step(self) -> float:
        """Step of the mesh, in seconds."""
        return float(self.run.state["step"][0])

    @property
    def every(self) -> int:
        """Each how-manieth step is stored."""
        return int(self.run.state["store_every"][0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """What a simulation gave, sample by sample, and the state from which it goes on.

    Attributes:
        system: its name.
        times: shape (n,), in seconds.
        states: shape (n, n_states).
        inputs: shape (n, n_inputs); at a jump the value after it.
        outputs: shape (n, n_outputs).
        state_names, input_names, output_names: what the columns are.
        state_units, input_units, output_units: their units.
        step: of the mesh, in seconds.
        notes: what was adjusted, in words.
        checkpoint: from which `resume` continues as if the run had not stopped.
    """

    system: str
    times: Floats
    states: Floats
    inputs: Floats
    outputs: Floats
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    step: float
    notes: tuple[str, ...]
    checkpoint: Checkpoint

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def end(self) -> tuple[float, ...]:
        """States where the run stopped, which is a sample only where the storing meets it."""
        return tuple(map(float, self.checkpoint.run.state["x"][0][: len(self.state_names)]))

    def output(self, name: str) -> Floats:
        """Samples of one output, shape (n,).

        Raises:
            InvalidInputError: there is no such output.
        """
        return _column(self.outputs, self.output_names, name)

    def input(self, name: str) -> Floats:
        """Samples of one input, shape (n,).

        Raises:
            InvalidInputError: there is no such input.
        """
        return _column(self.inputs, self.input_names, name)

    def state(self, name: str) -> Floats:
        """Samples of one state, shape (n,).

        Raises:
            InvalidInputError: there is no such state.
        """
        return _column(self.states, self.state_names, name)


def make_room(run: Run, steps: int, breaks: int = 16 * runs.ROOM_SEGMENTS) -> Run:
    """Drop nodes and segments that no reading can reach any more, and make room for a number of grid steps and breaks.

    It changes the state's indices.
    """
    s = run.state[0]
    channels = run.nodes.shape[1] - runs.NODE_VALUES
    newest, count = int(s["newest_segment"]), int(s["node_count"])
    oldest = min((int(k) for k in s["segment"][:channels]), default=newest)
    first = 0
    if oldest > 0:
        first = int(run.segments[oldest, runs.SEGMENT_START])
        used = min((int(k) for k in s["node"][:channels]), default=count)
        if oldest == newest:
            first = max(first, min(used, count) - MARGIN_NODES)
    dropped = max(oldest - 1, 0)
    segments = np.zeros((newest - dropped + breaks, run.segments.shape[1]))
    kept = run.segments[dropped + 1 : newest + 1]
    segments[1 : 1 + len(kept)] = kept
    segments[1 : 1 + len(kept), runs.SEGMENT_START] = np.maximum(kept[:, runs.SEGMENT_START] - first, 0)
    nodes = np.zeros((count - first + steps + steps // 4 + 4 * runs.ROOM_NODES, run.nodes.shape[1]))
    nodes[: count - first] = run.nodes[first:count]
    s["segment"] = np.maximum(s["segment"] - dropped, 0)
    s["boundary"] = np.maximum(s["boundary"] - dropped, 0)
    s["node"] = np.maximum(s["node"] - first, 0)
    s["cell_end"] = s["cell_start"]
    s["node_count"], s["newest_segment"] = count - first, newest - dropped
    return Run(state=run.state, nodes=nodes, segments=segments)


def _column(table: Floats, names: tuple[str, ...], name: str) -> Floats:
    if name not in names:
        message = f"there is no signal {name}; there are {', '.join(names)}"
        raise InvalidInputError(message, name=name)
    return table[:, names.index(name)]
