"""Connecting two systems into a third: a controller around an engine is a `DelaySystem` like any other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from revline.affine import Affine, Dependence, as_affine, unknown, varying
from revline.equations import Equation, equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable, index_of

Vector = tuple[Any, ...]
Select = Callable[[Vector], Vector]
Resolve = Callable[..., Vector]
"""From parameters, both systems' states, inputs as far as they are known, and both systems' readings: the inputs."""


class Pair(NamedTuple):
    """Parameters of two connected systems."""

    first: Any
    second: Any


class Wire(NamedTuple):
    """One connection: from which system's output to which system's input, by position; systems are 0 and 1."""

    source: int
    output: int
    target: int
    input: int


def connect(
    first: DelaySystem, second: DelaySystem, *, to_first: Mapping[str, str], to_second: Mapping[str, str], name: str
) -> DelaySystem:
    """Make one system of two by feeding outputs of each to inputs of the other.

    Outputs that depend on inputs at the same instant may form a loop. One loop along a straight line is solved exactly, whatever its gain
    depends on; any other is refused. The range of an input that is fed is not checked any more: the output that feeds it must limit itself.

    Args:
        first: its signals come first in the result.
        second: its signals follow; a name that the first has too is given the second's name as a prefix, blanks as underscores.
        to_first: for inputs of the first, the outputs of the second that feed them.
        to_second: for inputs of the second, the outputs of the first that feed them.
        name: of the result.

    Returns:
        A system with the states, channels and outputs of both, and with the inputs that nothing feeds.

    Raises:
        InvalidInputError: there is no such signal, the units of two ends differ, or outputs and inputs form an algebraic loop that is
            not one straight line or has a gain of 1; the message names the signals.
    """
    systems = (first, second)
    wires = (*_find_wires(second, first, to_first, 1), *_find_wires(first, second, to_second, 0))
    fed = {(w.target, w.input) for w in wires}
    free = tuple((k, j) for k in (0, 1) for j in range(len(systems[k].inputs)) if (k, j) not in fed)
    feed = _make_feed(_Layout(systems), wires, free)
    emit, lags, rate, output = _compose(systems, feed)
    return DelaySystem(
        name=name,
        parameters=Pair(first.parameters, second.parameters),
        states=_joined(first.states, second.states, second.name),
        inputs=_joined(
            tuple(systems[k].inputs[j] for k, j in free if k == 0), tuple(systems[k].inputs[j] for k, j in free if k == 1), second.name
        ),
        channels=_joined(first.channels, second.channels, second.name),
        outputs=_joined(first.outputs, second.outputs, second.name),
        emit=emit,
        lags=lags,
        rate=rate,
        output=output,
    )


def _joined(first: tuple[Variable, ...], second: tuple[Variable, ...], prefix: str) -> tuple[Variable, ...]:
    taken, before = {v.name for v in first}, prefix.replace(" ", "_")
    return (*first, *(v.renamed(f"{before}_{v.name}") if v.name in taken else v for v in second))


def _find_wires(source: DelaySystem, target: DelaySystem, names: Mapping[str, str], source_position: int) -> list[Wire]:
    wires = []
    for input_name, output_name in names.items():
        k, j = index_of(source.outputs, output_name), index_of(target.inputs, input_name)
        if source.outputs[k].unit != target.inputs[j].unit:
            message = (
                f"{source.name}'s {output_name} in {source.outputs[k].unit} cannot feed {target.name}'s {input_name} "
                f"in {target.inputs[j].unit}; convert it first"
            )
            raise InvalidInputError(message)
        wires.append(Wire(source_position, k, 1 - source_position, j))
    return wires


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where signals stand: inputs of both systems one after the other, then what is appended to them for a moment.

    An input that nothing has been found for yet holds a placeholder. No result that is kept depends on it, by the outputs' structure.
    """

    systems: tuple[DelaySystem, DelaySystem]

    @property
    def placeholders(self) -> Vector:
        """A value inside each input's range: not 0, as an equation may divide by it; not the nominal one, or each would need a kernel."""
        return tuple(float(min(max(1.0, v.low), v.high)) for system in self.systems for v in system.inputs)

    @property
    def width(self) -> int:
        """How many inputs both systems have."""
        return sum(len(system.inputs) for system in self.systems)

    def target(self, wire: Wire) -> int:
        """Position of the input that a wire feeds."""
        return wire.input + (len(self.systems[0].inputs) if wire.target else 0)

    def source(self, wire: Wire) -> int:
        """Position of the output that a wire takes, both systems' outputs appended to the inputs."""
        return self.width + wire.output + (len(self.systems[0].outputs) if wire.source else 0)

    def feeds_through(self, other: Wire, wire: Wire) -> bool:
        """Whether the output that a wire takes depends at the same instant on the input that another wire feeds."""
        return other.target == wire.source and f"u{other.input}" in self.systems[wire.source].structure.output[wire.output]

    def name(self, wire: Wire) -> str:
        """Name the output that a wire takes."""
        return f"{self.systems[wire.source].name}.{self.systems[wire.source].outputs[wire.output].name}"


def _order_wires(layout: _Layout, wires: Sequence[Wire]) -> tuple[tuple[tuple[Wire, ...], ...], tuple[Wire, ...]]:
    """Sort wires into levels, each reading no wired input but those of earlier levels, and what loops keep from being sorted."""
    waiting, levels = tuple(wires), []
    while waiting:
        ready = tuple(w for w in waiting if not any(layout.feeds_through(other, w) for other in waiting))
        if not ready:
            break
        levels.append(ready)
        waiting = tuple(w for w in waiting if w not in ready)
    return tuple(levels), waiting


def _make_feed(layout: _Layout, wires: Sequence[Wire], free: Sequence[tuple[int, int]]) -> Callable[..., tuple[Vector, Vector]]:
    """Make the function that finds both systems' inputs."""
    offset, placeholders = (0, len(layout.systems[0].inputs)), layout.placeholders
    places = {offset[k] + j: position for position, (k, j) in enumerate(free)}
    start = _select([places.get(k, len(free) + k) for k in range(layout.width)])
    split_first, split_second = _select(range(offset[1])), _select(range(offset[1], layout.width))
    levels, stuck = _order_wires(layout, wires)
    resolve = _close_loop(layout, wires, stuck) if stuck else _fill_in_order(layout, levels)

    @equation
    def feed(p: Pair, xs: tuple[Vector, Vector], u: Vector, zds: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
        known = resolve(p, xs, start(u + placeholders), zds)
        return split_first(known), split_second(known)

    return feed


def _make_outputs(layout: _Layout) -> Resolve:
    """Make the function that appends both systems' outputs to their inputs."""
    first, second = layout.systems
    split_first, split_second = _select(range(len(first.inputs))), _select(range(len(first.inputs), layout.width))
    output_first, output_second = first.output, second.output

    @equation
    def append(p: Pair, xs: tuple[Vector, Vector], known: Vector, zds: tuple[Vector, Vector]) -> Vector:
        of_first = output_first(p.first, xs[0], split_first(known), zds[0])
        values: Vector = known + of_first + output_second(p.second, xs[1], split_second(known), zds[1])
        return values

    return append


def _fill_in_order(layout: _Layout, levels: Sequence[Sequence[Wire]]) -> Resolve:
    """Make the function that finds wired inputs level by level."""
    append = _make_outputs(layout)

    @equation
    def unchanged(p: Pair, xs: tuple[Vector, Vector], known: Vector, zds: tuple[Vector, Vector]) -> Vector:  # noqa: ARG001 - one form
        return known

    def following(before: Resolve, fill: Select) -> Resolve:
        @equation
        def go_on(p: Pair, xs: tuple[Vector, Vector], known: Vector, zds: tuple[Vector, Vector]) -> Vector:
            return fill(append(p, xs, before(p, xs, known, zds), zds))

        return go_on

    chain: Resolve = unchanged
    for level in levels:
        sources = {layout.target(w): layout.source(w) for w in level}
        chain = following(chain, _select([sources.get(k, k) for k in range(layout.width)]))
    return chain


def _close_loop(layout: _Layout, wires: Sequence[Wire], stuck: Sequence[Wire]) -> Resolve:
    """Make the function that finds wired inputs where one linear algebraic loop stands among them.

    Raises:
        InvalidInputError: the loop is not linear, there are several that one wire does not break, or it has no single solution.
    """
    around = tuple(w for w in stuck if _reaches_itself(layout, stuck, w))
    loop = " and ".join(layout.name(w) for w in around)
    for torn in around:
        levels, left = _order_wires(layout, [w for w in wires if w != torn])
        if left:
            continue
        rest = _fill_in_order(layout, levels)
        answer = _make_answer(layout, rest, torn)
        gain = _trace_loop(layout, answer)
        if gain.dependence is Dependence.OTHER:
            continue
        if gain.slope == 1.0:
            message = f"algebraic loop through {loop}: its gain is 1, so that no single solution exists; change a gain or put a lag into it"
            raise InvalidInputError(message)
        return _solve_loop(layout, rest, answer, torn)
    message = (
        f"algebraic loop through {loop}: each depends on the other at the same instant, and not along one straight line, "
        "which alone is solved; put a lag or a filter into the loop"
    )
    raise InvalidInputError(message)


def _reaches_itself(layout: _Layout, wires: Sequence[Wire], wire: Wire) -> bool:
    reached: set[Wire] = set()
    front = {wire}
    while front:
        front = {w for w in wires if w not in reached and any(layout.feeds_through(other, w) for other in front)}
        reached |= front
    return wire in reached


def _make_answer(layout: _Layout, rest: Resolve, torn: Wire) -> Callable[..., Any]:
    """Make the function from a torn wire's value to the value that comes back around the loop."""
    put = _select([layout.width if k == layout.target(torn) else k for k in range(layout.width)])
    append, source = _make_outputs(layout), layout.source(torn)

    @equation
    def answer(p: Pair, xs: tuple[Vector, Vector], known: Vector, zds: tuple[Vector, Vector], value: float) -> float:
        filled = rest(p, xs, put(known + (value,)), zds)  # noqa: RUF005 - this form compiles
        came_back: float = append(p, xs, filled, zds)[source]
        return came_back

    return answer


def _trace_loop(layout: _Layout, answer: Callable[..., Any]) -> Affine:
    """Find how what comes back around the loop depends on what goes in."""
    first, second = layout.systems
    xs, zds = (
        (tuple(varying() for _ in a), tuple(varying() for _ in b))
        for a, b in ((first.states, second.states), (first.channels, second.channels))
    )
    known = tuple(varying() for _ in range(layout.width))
    return as_affine(answer(Pair(first.parameters, second.parameters), xs, known, zds, unknown()))


def _solve_loop(layout: _Layout, rest: Resolve, answer: Callable[..., Any], torn: Wire) -> Resolve:
    """Make the function that solves the loop: what goes in must come back, along the straight line through two trials, once refined."""
    put = _select([layout.width if k == layout.target(torn) else k for k in range(layout.width)])
    trial = layout.placeholders[layout.target(torn)]

    @equation
    def resolve(p: Pair, xs: tuple[Vector, Vector], known: Vector, zds: tuple[Vector, Vector]) -> Vector:
        came_back = answer(p, xs, known, zds, trial)
        span = np.sqrt(1.0 + came_back * came_back)  # of the size of what comes back: the slope then loses no digits
        slope = (answer(p, xs, known, zds, trial + span) - came_back) / span
        near = trial + (came_back - trial) / (1.0 - slope)
        value = near + (answer(p, xs, known, zds, near) - near) / (1.0 - slope)  # a solution far smaller than the trials needs it
        return rest(p, xs, put(known + (value,)), zds)  # noqa: RUF005 - this form compiles

    return resolve


def _compose(systems: tuple[DelaySystem, DelaySystem], feed: Callable[..., tuple[Vector, Vector]]) -> tuple[Equation, ...]:
    first, second = systems
    n, c = len(first.states), len(first.channels)
    x_first, x_second = _select(range(n)), _select(range(n, n + len(second.states)))
    z_first, z_second = _select(range(c)), _select(range(c, c + len(second.channels)))

    def join(of_first: Equation, of_second: Equation) -> Equation:
        @equation
        def joined(p: Pair, x: Vector, u: Vector, zd: Vector) -> Vector:
            xa, xb, za, zb = x_first(x), x_second(x), z_first(zd), z_second(zd)
            ua, ub = feed(p, (xa, xb), u, (za, zb))
            values: Vector = of_first(p.first, xa, ua, za) + of_second(p.second, xb, ub, zb)
            return values

        return joined

    return tuple(
        join(a, b)
        for a, b in ((first.emit, second.emit), (first.lags, second.lags), (first.rate, second.rate), (first.output, second.output))
    )


def _select(indices: Sequence[int]) -> Select:
    """Make a function that picks entries of a tuple by position, in a form that compiles."""
    if len(indices) > 4:
        head, tail = _select(indices[:4]), _select(indices[4:])
        return lambda pool: head(pool) + tail(pool)
    if not indices:
        return lambda _: ()
    i, j, k, m = (*indices, *[indices[0]] * (4 - len(indices)))
    choices: tuple[Select, ...] = (
        lambda pool: (pool[i],),
        lambda pool: (pool[i], pool[j]),
        lambda pool: (pool[i], pool[j], pool[k]),
        lambda pool: (pool[i], pool[j], pool[k], pool[m]),
    )
    return choices[len(indices) - 1]
