"""Connecting two systems into a third: a controller around an engine is a `DelaySystem` like any other."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from revline.equations import Equation, equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable, index_of

Vector = tuple[Any, ...]
Select = Callable[[Vector], Vector]


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

    Args:
        first: its signals come first in the result.
        second: its signals follow; a name that the first has too is given the second's name as a prefix.
        to_first: for inputs of the first, the outputs of the second that feed them.
        to_second: for inputs of the second, the outputs of the first that feed them.
        name: of the result.

    Returns:
        A system with the states, channels and outputs of both, and with the inputs that nothing feeds.

    Raises:
        InvalidInputError: there is no such signal, the units of two ends differ, or outputs and inputs form an algebraic loop.
    """
    systems = (first, second)
    wires = (*_find_wires(second, first, to_first, 1), *_find_wires(first, second, to_second, 0))
    levels = _order_wires(systems, wires)
    free = tuple((k, j) for k in (0, 1) for j in range(len(systems[k].inputs)) if not any(w.target == k and w.input == j for w in wires))
    feed = _make_feed(systems, levels, free)
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
    taken = {v.name for v in first}
    return (*first, *(v.renamed(f"{prefix}_{v.name}") if v.name in taken else v for v in second))


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


def _order_wires(systems: tuple[DelaySystem, DelaySystem], wires: Sequence[Wire]) -> tuple[tuple[Wire, ...], ...]:
    """Sort wires into levels: each level's outputs read no wired input but those of earlier levels."""
    waiting, levels = list(wires), []
    while waiting:
        ready = [w for w in waiting if not any(_feeds_through(systems, other, w) for other in waiting)]
        if not ready:
            loop = ", ".join(f"{systems[w.source].name}.{systems[w.source].outputs[w.output].name}" for w in waiting)
            message = f"algebraic loop through {loop}: each depends on the others at the same instant; put a lag or a filter into the loop"
            raise InvalidInputError(message)
        levels.append(tuple(ready))
        waiting = [w for w in waiting if w not in ready]
    return tuple(levels)


def _feeds_through(systems: tuple[DelaySystem, DelaySystem], other: Wire, wire: Wire) -> bool:
    """Whether the output that a wire takes depends at the same instant on the input that another wire feeds."""
    return other.target == wire.source and f"u{other.input}" in systems[wire.source].structure.output[wire.output]


def _make_feed(
    systems: tuple[DelaySystem, DelaySystem], levels: Sequence[Sequence[Wire]], free: Sequence[tuple[int, int]]
) -> Callable[..., tuple[Vector, Vector]]:
    """Make the function that finds both systems' inputs, level by level; what is not known yet holds its nominal value."""
    first, second = systems
    nominal = (tuple(float(v.nominal) for v in first.inputs), tuple(float(v.nominal) for v in second.inputs))
    offset = (0, len(first.inputs))
    places = {offset[k] + j: position for position, (k, j) in enumerate(free)}
    start = _select([places.get(k, len(free) + k) for k in range(len(first.inputs) + len(second.inputs))])
    all_nominal = (*nominal[0], *nominal[1])
    steps: list[Select] = []
    width, outputs = len(all_nominal), (0, len(first.outputs))
    for level in levels:
        sources = {offset[w.target] + w.input: width + outputs[w.source] + w.output for w in level}
        steps.append(_select([sources.get(k, k) for k in range(width)]))
    split_first, split_second = _select(range(offset[1])), _select(range(offset[1], width))
    output_first, output_second = first.output, second.output

    @equation
    def begin(p: Pair, xs: tuple[Vector, Vector], u: Vector, zds: tuple[Vector, Vector]) -> Vector:  # noqa: ARG001 - one form
        return start(u + all_nominal)

    def following(before: Callable[..., Vector], fill: Select) -> Callable[..., Vector]:
        @equation
        def go_on(p: Pair, xs: tuple[Vector, Vector], u: Vector, zds: tuple[Vector, Vector]) -> Vector:
            known = before(p, xs, u, zds)
            ya = output_first(p.first, xs[0], split_first(known), zds[0])
            yb = output_second(p.second, xs[1], split_second(known), zds[1])
            return fill(known + ya + yb)

        return go_on

    chain: Callable[..., Vector] = begin
    for fill in steps:
        chain = following(chain, fill)

    @equation
    def feed(p: Pair, xs: tuple[Vector, Vector], u: Vector, zds: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
        known = chain(p, xs, u, zds)
        return split_first(known), split_second(known)

    return feed


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
