"""Samples at values of a state: what is in time, what is tried anew, and what is refused."""

import numpy as np
import pytest

from revline.dde.failures import explain
from revline.dde.run import BY_STATE, state_type
from revline.dde.sampling import MOST_CORRECTIONS, missed
from revline.engine.lee1995 import lee1995
from revline.errors import SimulationError


@pytest.mark.parametrize(("late", "in_time"), [(5e-13, True), (-5e-11, True), (1e-4, False), (-1e-4, False)])
def test_a_sample_whose_time_is_not_found_is_refused(late: float, in_time: bool) -> None:  # noqa: FBT001 - a case of the test
    """After all corrections the state may be off by what it rounds to, and no more: its step is refused, with the reason."""
    engine = lee1995()
    s = np.zeros(1, state_type(engine)).view(np.recarray)[0]
    s.sampling, s.sampled_state, s.state_target, s.tolerance = BY_STATE, 1, 200.0, 1e-12
    s.time, s.end, s.sample_time, s.corrections = 1.0, 1.001, 1.001, MOST_CORRECTIONS
    s.rates[1] = 50.0
    s.x_next[:2] = 30.0, 200.0 + 50.0 * late
    assert not missed(s)
    assert np.isnan(s.x_next[1]) == (not in_time)
    if not in_time:
        error = explain(engine, s)
        assert type(error) is SimulationError
        assert "the time at which engine_speed passes 200, of the next sample, is not found in 20 corrections" in str(error)
        assert "give a smaller step" in str(error)
