import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline import signals
from revline.connection import connect
from revline.dde.simulate import Start, simulate
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable
from tests.blocks import (
    Block,
    Difference,
    Vector,
    block,
    directly,
    exact,
    limited,
    nothing,
    read_out,
    scheduled,
    strictly,
    summing,
    transfer,
)

S = 1j * np.geomspace(0.01, 100.0, 40)
size = st.floats(0.1, 5.0)
blocks = st.builds(Block, gain=size, pole=size, delay=size, direct=st.floats(-0.9, 0.9))


@given(p=blocks, q=blocks)
def test_a_chain_is_the_product_a_delay_after_a_delay_included(p: Block, q: Block) -> None:
    chain = connect(block("a", read_out, p), block("b", directly, q), to_first={}, to_second={"drive": "answer"}, name="chain")
    assert [v.name for v in chain.channels] == ["sent", "b_sent"]
    assert chain.structure.emit[1] == {"zd0"}
    product = p.gain * np.exp(-S * p.delay) * exact(q, S, direct=True)
    np.testing.assert_allclose(transfer(chain, S)[:, 0], product, rtol=1e-12)
    assert chain.structure.output[1] == {"x1", "zd0"}


@given(p=blocks, scale=size)
def test_a_loop_is_l_over_one_plus_l(p: Block, scale: float) -> None:
    loop = connect(
        block("plant", strictly, p), summing(scale=scale), to_first={"drive": "error"}, to_second={"measured": "answer"}, name="loop"
    )
    open_loop = scale * exact(p, S, direct=False)
    assert [v.name for v in loop.inputs] == ["command"]
    np.testing.assert_allclose(transfer(loop, S, 0)[:, 0], open_loop / (1.0 + open_loop), rtol=1e-12)
    np.testing.assert_allclose(transfer(loop, S, 1)[:, 0], scale / (1.0 + open_loop), rtol=1e-12)


@given(p=blocks, q=blocks)
def test_two_blocks_around_each_other_obey_the_algebra(p: Block, q: Block) -> None:
    """One of them passes its input straight through: two levels of wires. Order of the two does not matter."""
    pair = (block("a", strictly, p), block("b", directly, q))
    with_input = connect(pair[0], summing(), to_first={"drive": "error"}, to_second={}, name="a with sum")
    loop = connect(with_input, pair[1], to_first={"measured": "answer"}, to_second={"drive": "answer"}, name="l")
    turned = connect(pair[1], with_input, to_first={"drive": "answer"}, to_second={"measured": "answer"}, name="l")
    forward, back = exact(p, S, direct=False), exact(q, S, direct=True)
    np.testing.assert_allclose(transfer(loop, S, 0)[:, 0], forward / (1.0 + forward * back), rtol=1e-12)
    np.testing.assert_allclose(transfer(turned, S, 1)[:, 0], forward / (1.0 + forward * back), rtol=1e-12)


@given(p=blocks, scale=size, command=st.floats(-5.0, 5.0))
def test_a_linear_algebraic_loop_is_solved(p: Block, scale: float, command: float) -> None:
    """y = x + d e, e = scale (r - y): both depend on each other at the same instant, with a gain of - scale d."""
    if abs(1.0 + scale * p.direct) < 0.05:
        return
    systems = (block("plant", directly, p), summing(scale=scale))
    for loop in (
        connect(*systems, to_first={"drive": "error"}, to_second={"measured": "answer"}, name="loop"),
        connect(*systems[::-1], to_first={"measured": "answer"}, to_second={"drive": "error"}, name="loop"),
    ):
        position = [v.name for v in loop.outputs].index("answer")
        open_loop = scale * exact(p, S, direct=True)
        tolerance = 1e-12 / abs(1.0 + scale * p.direct)
        np.testing.assert_allclose(transfer(loop, S, position)[:, 0], open_loop / (1.0 + open_loop), rtol=tolerance)
        y = loop.output(loop.parameters, (0.7,), (command,), (0.3,))[position]
        e = loop.output(loop.parameters, (0.7,), (command,), (0.3,))[1 - position]
        assert y == pytest.approx(0.7 + p.direct * e, rel=1e-11, abs=1e-11)
        assert e == pytest.approx(scale * (command - y), rel=1e-10, abs=1e-10)


@given(command=st.floats(-3.0, 3.0), level=st.floats(-1e6, 1e6))
def test_a_loop_whose_gain_varies_is_solved_at_every_value(command: float, level: float) -> None:
    loop = connect(block("plant", directly), summing(scheduled), to_first={"drive": "error"}, to_second={"measured": "answer"}, name="loop")
    y, e = loop.output(loop.parameters, (level,), (command,), (0.0,))
    gain = math.exp(0.1 * command) / (2.0 + math.sin(command))
    assert e == pytest.approx((gain * (command - level) - level) / (1.0 + 0.5 * (1.0 + gain)), rel=1e-12, abs=1e-12)
    assert y == pytest.approx(level + 0.5 * e, rel=1e-12, abs=1e-9)


def test_what_follows_a_solved_loop_reads_its_solution() -> None:
    """The second's other output leaves through a wire behind the loop; only the loop's own signals are named in errors."""
    two = replace(
        summing(),
        inputs=(*summing().inputs, Variable(name="echo", unit="m")),
        outputs=(*summing().outputs, Variable(name="twice", unit="m")),
        output=difference_and_echo,
    )
    loop = connect(block("plant", directly), two, to_first={"drive": "error"}, to_second={"measured": "answer", "echo": "answer"}, name="l")
    y, e, twice = loop.output(loop.parameters, (0.6,), (1.0,), (0.0,))
    assert (y, e, twice) == pytest.approx((1.1 / 1.5, 0.4 / 1.5, 2.2 / 1.5), rel=1e-14)
    bent = replace(two, output=limited_and_echo)
    with pytest.raises(InvalidInputError, match=r"^algebraic loop through sum\.error and plant\.answer: .* put a lag or a filter"):
        connect(block("plant", directly), bent, to_first={"drive": "error"}, to_second={"measured": "answer", "echo": "answer"}, name="l")


@equation
def difference_and_echo(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return p.scale * (u[0] - u[1]), 2.0 * u[2]


@equation
def limited_and_echo(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return np.minimum(p.scale * (u[0] - u[1]), 1.0), 2.0 * u[2]


@pytest.mark.parametrize("bend", ["limited", "product", "divided", "power", "exponent", "function", "reduction"])
def test_other_algebraic_loops_are_refused_and_name_both_signals(bend: str) -> None:
    plant = block("plant", directly)
    with pytest.raises(
        InvalidInputError, match=r"algebraic loop through sum\.error and plant\.answer: each depends on the other at the same"
    ):
        connect(plant, summing(BENDS[bend]), to_first={"drive": "error"}, to_second={"measured": "answer"}, name="loop")


@equation
def product(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[1] * (u[0] - u[1]),)


@equation
def divided(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[0] / u[1],)


@equation
def power(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[1] ** 2.0,)


@equation
def exponent(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (2.0 ** u[1],)


@equation
def function(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 - np.divide(1.0, np.add(np.tanh(u[1]), 3.0)),)


@equation
def reduction(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (3.0 / (u[0] + u[1]),)


BENDS = {
    "limited": limited,
    "product": product,
    "divided": divided,
    "power": power,
    "exponent": exponent,
    "function": function,
    "reduction": reduction,
}


def test_a_loop_of_gain_one_has_no_solution() -> None:
    plant = block("plant", directly, Block(direct=-0.5))
    with pytest.raises(InvalidInputError, match=r"loop through sum\.error and plant\.answer: its gain is 1, so that no single solution"):
        connect(plant, summing(scale=2.0), to_first={"drive": "error"}, to_second={"measured": "answer"}, name="loop")


@equation
def crossed(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return p.scale * u[0], p.scale * u[1]


def test_two_loops_that_no_one_wire_breaks_are_refused() -> None:
    two = DelaySystem(
        name="two",
        parameters=Difference(0.5),
        states=(),
        inputs=(Variable(name="a", unit="m"), Variable(name="b", unit="m")),
        channels=(),
        outputs=(Variable(name="c", unit="m"), Variable(name="d", unit="m")),
        emit=nothing,
        lags=nothing,
        rate=nothing,
        output=crossed,
    )
    other = replace(two, name="other")
    with pytest.raises(InvalidInputError, match=r"through other\.c and other\.d and two\.c and two\.d: each depends"):
        connect(two, other, to_first={"a": "c", "b": "d"}, to_second={"a": "c", "b": "d"}, name="loops")


@equation
def dividing(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return 1.0 * u[0], p.scale / u[1]


def test_placeholders_divide_without_harm_and_never_reach_a_result() -> None:
    """The first pass evaluates 1 / u1 before u1 is known; only what does not read u1 is kept, whatever stands in its place."""
    outputs = (Variable(name="through", unit="m"), Variable(name="inverse", unit="m"))
    both = replace(summing(), output=dividing, outputs=outputs)
    for low, high, nominal in ((-math.inf, math.inf, 0.0), (-4.0, -2.0, 0.0), (0.0, 0.5, 0.0), (-1.0, 1.0, -1.0)):
        inputs = (both.inputs[0], replace(both.inputs[1], low=low, high=high, nominal=nominal))
        first = replace(both, inputs=inputs)
        plant = block("plant", strictly)
        loop = connect(first, plant, to_first={"measured": "answer"}, to_second={"drive": "through"}, name="loop")
        assert loop.output(loop.parameters, (4.0,), (3.0,), (0.0,)) == (3.0, 0.25, 4.0)
        assert loop.emit(loop.parameters, (4.0,), (3.0,), (0.0,)) == (6.0,)
        assert loop.structure.output == (frozenset({"u0"}), frozenset({"x0"}), frozenset({"x0"}))


@equation
def many(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return tuple(p.scale * (k + 1.0) * v for k, v in enumerate(u))


@pytest.mark.parametrize("count", [1, 4, 5, 8, 9, 17])
def test_many_signals_keep_their_places(count: int) -> None:
    def wide(name: str) -> DelaySystem:
        return DelaySystem(
            name=name,
            parameters=Difference(1.0),
            states=(),
            inputs=tuple(Variable(name=f"in{k}", unit="m") for k in range(count)),
            channels=(),
            outputs=tuple(Variable(name=f"out{k}", unit="m") for k in range(count)),
            emit=nothing,
            lags=nothing,
            rate=nothing,
            output=many,
        )

    turned = {f"in{k}": f"out{(k + 1) % count}" for k in range(count)}
    chain = connect(wide("a"), wide("b"), to_first={}, to_second=turned, name="chain")
    u = tuple(float(k) + 0.5 for k in range(count))
    first = [(k + 1.0) * v for k, v in enumerate(u)]
    assert chain.output(chain.parameters, (), u, ()) == (*first, *((k + 1.0) * first[(k + 1) % count] for k in range(count)))
    part = connect(wide("a"), wide("b"), to_first={}, to_second={"in0": "out0"}, name="part")
    assert [v.name for v in part.inputs] == [*(f"in{k}" for k in range(count)), *(f"b_in{k}" for k in range(1, count))]
    assert part.output(part.parameters, (), tuple(map(float, range(2 * count - 1))), ())[count:] == (
        0.0,
        *((k + 1.0) * (count + k - 1.0) for k in range(1, count)),
    )


def test_names_units_and_signals_are_checked() -> None:
    plant, total = block("the plant", strictly), summing()
    twin = connect(plant, plant, to_first={}, to_second={"drive": "answer"}, name="twin")
    assert [v.name for v in (*twin.states, *twin.inputs, *twin.outputs)] == [
        "level",
        "the_plant_level",
        "drive",
        "answer",
        "the_plant_answer",
    ]
    with pytest.raises(InvalidInputError, match=r"2 states are named the_plant_level"):
        connect(twin, plant, to_first={}, to_second={}, name="triplet")
    with pytest.raises(InvalidInputError, match=r"there is no signal eror; there are error"):
        connect(plant, total, to_first={"drive": "eror"}, to_second={}, name="loop")
    with pytest.raises(InvalidInputError, match=r"there is no signal drve; there are drive"):
        connect(plant, total, to_first={"drve": "error"}, to_second={}, name="loop")
    miles = replace(total, outputs=(Variable(name="error", unit="mile"),))
    with pytest.raises(InvalidInputError, match=r"sum's error in mile cannot feed the plant's drive in m; convert it first"):
        connect(plant, miles, to_first={"drive": "error"}, to_second={}, name="loop")


@equation
def own_lag(p: Block, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.delay + 0.01 * u[0] * u[0],)


def test_a_lag_that_would_read_a_later_channel_is_refused_and_the_other_order_works() -> None:
    late, reading = replace(block("late", strictly), lags=own_lag), block("reading", read_out)
    with pytest.raises(
        InvalidInputError, match="the lag of channel sent depends on its own or a later channel's reading; order the channels"
    ):
        connect(late, reading, to_first={"drive": "answer"}, to_second={}, name="chain")
    chain = connect(reading, late, to_first={}, to_second={"drive": "answer"}, name="chain")
    assert chain.structure.lags == (frozenset(), frozenset({"zd0"}))


def test_a_solved_loop_compiles() -> None:
    """Until the delay has passed, the level rests: y = d e, e = r - y, exactly; afterwards x' = e(t - delay) - x."""
    p = Block(gain=1.0, pole=1.0, delay=0.5, direct=0.5)
    loop = connect(block("plant", directly, p), summing(), to_first={"drive": "error"}, to_second={"measured": "answer"}, name="loop")
    run = simulate(loop, Start(states=np.zeros(1), inputs=np.zeros(1)), {"command": signals.step(3.0)}, until=1.0, step=0.05)
    early = run.times < 0.5
    np.testing.assert_allclose(run.output("answer")[early], 1.0, rtol=1e-14)
    late = run.times[~early] - 0.5
    level = 2.0 * (1.0 - np.exp(-late))
    np.testing.assert_allclose(run.states[~early, 0], level, atol=2e-8)
    np.testing.assert_allclose(run.output("error")[~early], (3.0 - level) / 1.5, atol=2e-8)
