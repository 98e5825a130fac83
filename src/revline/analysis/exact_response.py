"""The exact small-signal response of any delay system: linearised with its delays kept, its phase with all turns."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.linearize import linearize
from revline.analysis.phase_turns import find_known_delay, follow_phase
from revline.analysis.trim import Trim
from revline.errors import NotConvergedError, out_of_range
from revline.lti.response import FrequencyResponse, check_frequencies
from revline.system import DelaySystem
from revline.units import DEGREE


def find_exact_response(system: DelaySystem, trim: Trim, frequencies: ArrayLike, *, input_name: str, output_name: str) -> FrequencyResponse:
    """Find how an output answers an input at vanishing amplitude.

    The lags that the response contains are stated as its known delay, so that its phase has all turns on coarse frequencies too.

    Args:
        system: any system with delay channels.
        trim: where.
        frequencies: in rad/s, above 0, strictly rising.
        input_name: what is moved.
        output_name: what answers.

    Raises:
        InvalidInputError: a frequency or a name cannot be used.
        AnalysisError: a pole lies at one of the frequencies.
        NotConvergedError: the frequencies are too far apart for the phase to be unwrapped from their values.
    """
    omega = check_frequencies(frequencies)
    if omega[0] == 0.0:
        raise out_of_range("frequency", 0.0, "rad/s", "values above 0", "ask for the gain at rest instead")
    model = linearize(system, trim).model
    plain = model.response(omega, input_name, output_name)
    phases = follow_phase(model, omega, input_name, output_name) / DEGREE
    delay, fits = find_known_delay(plain, phases, np.array([*trim.lags, np.sum(trim.lags)]))
    if not fits:
        message = (
            f"the phase of {output_name} turns too far between the {omega.size} frequencies up to {omega[-1]:g} rad/s to be "
            "told from the values there; give more frequencies between them"
        )
        raise NotConvergedError(message, frequencies=omega.size)
    return replace(plain, known_delay=delay)
