"""The exact small-signal response of any delay system: linearised with its delays kept, its phase with all turns."""

from dataclasses import replace

from numpy.typing import ArrayLike

from revline.analysis.linearize import linearize
from revline.analysis.phase_turns import follow_phase
from revline.analysis.trim import Trim
from revline.errors import out_of_range
from revline.lti.response import FrequencyResponse, check_frequencies, count_turns
from revline.system import DelaySystem
from revline.units import DEGREE


def find_exact_response(system: DelaySystem, trim: Trim, frequencies: ArrayLike, *, input_name: str, output_name: str) -> FrequencyResponse:
    """Find how an output answers an input at vanishing amplitude.

    The phase has all its turns however far apart the frequencies are and wherever they begin: it is followed from a thousandth of the
    lowest one on, as densely as the lags ask for.

    Args:
        system: any system with delay channels.
        trim: where.
        frequencies: in rad/s, above 0, strictly rising.
        input_name: what is moved.
        output_name: what answers.

    Raises:
        InvalidInputError: a frequency or a name cannot be used.
        AnalysisError: a pole lies at one of the frequencies.
        NotConvergedError: the output does not answer, or its phase turns too fast to be followed up to the highest frequency.
    """
    omega = check_frequencies(frequencies)
    if omega[0] == 0.0:
        raise out_of_range("frequency", 0.0, "rad/s", "values above 0", "ask for the gain at rest instead")
    model = linearize(system, trim).model
    plain = model.response(omega, input_name, output_name)
    phases = follow_phase(model, omega, input_name, output_name) / DEGREE
    return replace(plain, turns=count_turns(plain.values, phases))
