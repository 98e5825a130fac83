"""What tuning rules give as controller files."""

from pathlib import Path

from revline.design.tuning.rules import tune_by_rule
from revline.io.controller_files import read_controller
from revline.io.json_files import write_json
from revline.io.rule_records import tuned_record
from revline.lti.transfer_function import TransferFunction


def test_the_setpoint_weight_that_a_rule_recommends_is_the_files(tmp_path: Path) -> None:
    """AMIGO's for PID is 0 where the lag dominates; a file without it would run with 1."""
    lag = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.5), delay=0.1, input_unit="deg", output_unit="rad/s")
    weights = []
    for rule in ("amigo", "amigo-pi"):
        record = tuned_record(tune_by_rule(rule, lag, options={}, designed_on="a lag"), provenance={})
        write_json(tmp_path / "c.json", record, "controller file")
        weights.append(read_controller(tmp_path / "c.json").controller.setpoint_weight)
    assert weights == [0.0, 1.0]
