"""Controllers, and a plant, that several tests share."""

from typing import Final

from revline.design.controllers.controller import PidGains
from revline.lti.transfer_function import TransferFunction

C2D: Final = PidGains(kp=1.2, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="fine-tuned", designed_on="g2d")
"""The thesis's controller for the second-order model with delay. Source: Lee (1995), chapter 5."""


def delayed_lag(delay: float, *, gain: float = 12.0, lag: float = 0.5) -> TransferFunction:
    """Make a plant from throttle to speed of one lag with transport delay, about as fast as the engine."""
    return TransferFunction(
        numerator=(gain,),
        denominator=(1.0, lag),
        delay=delay,
        input_name="throttle",
        input_unit="deg",
        output_name="speed",
        output_unit="rad/s",
    )
