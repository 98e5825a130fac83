from dataclasses import replace

import numpy as np
import pytest

from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import LoopRun, LoopTask, run_linear_loop
from revline.design.loops.outcome import Settled
from revline.lti.transfer_function import TransferFunction
from revline.studies.guidelines import _foresees
from revline.studies.steps import fit_models
from revline.studies.words import ending

LAG = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034), delay=0.02, input_unit="deg", output_unit="rad/s")


def loop(kp: float) -> LoopRun:
    gains = PidGains(kp=kp, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="test", designed_on="test")
    return run_linear_loop(LAG, gains, LoopTask(command=60.0, until=30.0), name="lag")


def test_a_model_foresees_an_ending_only_with_its_overshoot() -> None:
    """Of loops that settle, 8 % of overshoot on the model says nothing of 38 % on the engine; of two that do not, the ending tells."""
    whole, reduced, unstable = loop(1.2), loop(0.12), loop(12.0)
    assert not unstable.is_stable
    assert _foresees(whole, whole)
    assert not _foresees(whole, reduced)
    assert not _foresees(whole, unstable)
    assert _foresees(unstable, unstable)


def test_a_loop_that_rests_off_its_target_is_not_foreseen_by_one_that_meets_it() -> None:
    """As where a limit of the throttle holds the engine short of what is commanded, without overshoot."""
    whole = loop(1.2)
    assert isinstance(whole.outcome, Settled)
    short = replace(whole, outcome=replace(whole.outcome, steady_error=0.1 * whole.command))
    assert not _foresees(whole, short)
    assert _foresees(short, short)
    assert (ending(whole), ending(short)) == ("settles", "settles off target")


def test_a_response_that_no_model_fits_well_does_not_end_the_study() -> None:
    """A resonance of a tenth of critical damping and a notch: all six structures are rejected, each with its reasons."""
    plant = TransferFunction(
        numerator=(12.0, 0.012, 0.12), denominator=(1.0, 0.6, 0.07, 0.01, 0.001), delay=0.02, input_unit="deg", output_unit="rad/s"
    )
    models = fit_models(replace(plant.response(np.geomspace(0.05, 60.0, 30)), method="test"))
    assert models.chosen == ""
    assert all(verdict.text.startswith("rejected: ") for verdict in models.verdicts)
    assert pytest.approx(12.0, rel=0.5) == models.fit("g2").fit.model.static_gain
