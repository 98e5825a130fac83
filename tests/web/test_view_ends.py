"""Where what is asked has no end or no answer: a view says what would have one."""

import re

from tests.web.test_views import view


def test_a_sinusoid_that_stalls_the_engine_is_answered_in_part_and_the_amplitude_that_would_do_is_told() -> None:
    response = view({"throttle_deg": 10.0, "amplitude_deg": 9.0}, "response")["response"]
    note = next(note for note in response["harmonic_balance"]["notes"] if "; missing: " in note)
    found = re.match(
        r"15 of 42 frequencies are finished with 9 deg, each of them has an answer up to (\d\.\d+) deg; missing: 0.01 rad/s", note
    )
    assert found is not None
    whole = view({"throttle_deg": 10.0, "amplitude_deg": float(found[1])}, "response")["response"]["harmonic_balance"]
    assert len(whole["frequency_rad_s"]) == 42
