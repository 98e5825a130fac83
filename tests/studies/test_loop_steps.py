"""How long and how finely the study runs a loop until it can be told how it ends."""

import pytest

from revline.design.controllers.controller import PidGains
from revline.design.loops.outcome import LimitCycle
from revline.errors import NotSettledError
from revline.studies import loop_steps, steps
from revline.studies.config import StudyConfig

pytestmark = pytest.mark.slow


def test_a_cycle_of_few_samples_is_told_by_finer_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 60 deg the engine is fast: a cycle of 29 ms has 29 samples of 1 ms, and repeats within the criterion only on a finer mesh."""
    config = StudyConfig(throttle_deg=60.0, half_range_deg=20.0, amplitude_deg=10.0)
    engine = config.load_engine()
    point = steps.find_point(engine, config)
    gains = PidGains(kp=8.0, ki=9.0, kd=0.4, input_unit="rad/s", output_unit="deg", rule="given", designed_on="g2d")
    models = steps.fit_models(steps.table_response())
    row = loop_steps._run_until_decided(engine, point, models, gains, "engine", 100.0)  # noqa: SLF001 - the ladder itself
    assert isinstance(row.outcome, LimitCycle)
    monkeypatch.setattr(loop_steps, "HORIZONS", tuple(entry for entry in loop_steps.HORIZONS if entry[1] == 1e-3))
    with pytest.raises(NotSettledError):
        loop_steps._run_until_decided(engine, point, models, gains, "engine", 100.0)  # noqa: SLF001 - the ladder itself
