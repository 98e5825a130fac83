import typing

from revline.design.loops.outcome import Diverged, LimitCycle, Outcome, Settled, Stalled


def test_an_outcome_is_one_of_four_with_a_name_each() -> None:
    assert typing.get_args(Outcome) == (Settled, LimitCycle, Diverged, Stalled)
    assert [kind.name for kind in typing.get_args(Outcome)] == ["settled", "limit-cycle", "diverged", "stalled"]


def test_amplitude_of_a_cycle_is_half_its_height() -> None:
    cycle = LimitCycle(low=291.0, high=310.0, period=0.2, low_spread=0.0, high_spread=0.0, period_spread=0.0, cycles=9, swings=1, drift=0.0)
    assert cycle.amplitude == 9.5


def test_a_stall_names_the_state() -> None:
    assert Stalled(time=1.0, state="engine_speed", value=0.0).state == "engine_speed"
