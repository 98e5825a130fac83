"""Controllers that several tests share."""

from typing import Final

from revline.design.controller import PidGains

C2D: Final = PidGains(kp=1.2, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="fine-tuned", designed_on="g2d")
"""The thesis's controller for the second-order model with delay. Source: Lee (1995), chapter 5."""
