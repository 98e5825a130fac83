"""A sampled controller as a MATLAB function, written from the same equations as the simulation runs; no toolbox is needed."""

import math
from collections.abc import Mapping
from typing import Any, Final

from revline.io.recorded_operations import Statement, check_names, flat_parameters, given, named_parameters, write_statements
from revline.sampled import SampledController

LIMITS: Final = """
function c = minimum(a, b)
    % The smaller of two; what is no number stays none (MATLAB's own min passes it over).
    if isnan(a), c = a; elseif isnan(b), c = b; elseif a < b, c = a; else, c = b; end
end

function c = maximum(a, b)
    if isnan(a), c = a; elseif isnan(b), c = b; elseif a > b, c = a; else, c = b; end
end

function c = fmin(a, b)
    if isnan(a), c = b; elseif isnan(b), c = a; elseif a < b, c = a; else, c = b; end
end

function c = fmax(a, b)
    if isnan(a), c = b; elseif isnan(b), c = a; elseif a > b, c = a; else, c = b; end
end
"""


def write_matlab_controller(controller: SampledController, *, name: str, about: Mapping[str, str], units: Mapping[str, str]) -> str:
    """Write a sampled controller as the text of NAME.m.

    Args:
        controller: whose equations and parameters are written.
        name: of the function and its file.
        about: what the head of the file says, by key.
        units: of the parameters, by name.

    Returns:
        A function [state, output] = NAME(state, measurement, command, seconds), which begins with a state of [] at rest.

    Raises:
        InvalidInputError: the name of a signal is none in code.
    """
    check_names(controller)
    parameters: Any = controller.parameters
    y, r = tuple(given(v.name) for v in controller.measurements), tuple(given(v.name) for v in controller.commands)
    p = named_parameters(parameters)
    states = [v.name for v in controller.states]
    started = controller.start(p, y, r, tuple(given(f"{v.name}_now") for v in controller.outputs[: controller.drives]))
    updated = controller.update(p, tuple(given(f"state.{n}") for n in states), y, r, (given("seconds"),))
    following = [*(f"next.{n}" for n in states), *(f"output.{v.name}" for v in controller.outputs)]
    inputs = ", ".join(v.name for v in (*controller.measurements, *controller.commands))
    now = ", ".join(f"{v.name}_now" for v in controller.outputs[: controller.drives])
    head = "\n".join(f"% {key}: {' '.join(value.split())}" for key, value in about.items())
    values = flat_parameters(parameters)
    constants = "\n".join(f"    p.{field} = {_literal(value)}; % [{units.get(field, '1')}]" for field, value in values)
    meanings = "\n".join(f"%   {v.name} [{' '.join(v.unit.split())}]: {v.description}" for v in controller.outputs)
    return f"""function [state, output] = {name}(state, {inputs}, seconds, {now})
% {name}: a sampled controller.
{head}
%
% [state, output] = {name}([], {inputs}, seconds, {now}) starts where the first output is {now};
% [state, output] = {name}(state, {inputs}, seconds) is one sample, so many seconds after the one before.
% output:
{meanings}
{constants}
    if isempty(state)
{_code(write_statements(started, [f"state.{n}" for n in states], _literal, prefix="w"), "        ")}
    end
{_code(write_statements(updated, following, _literal), "    ")}
    state = next;
end
{LIMITS}"""


def _code(statements: tuple[Statement, ...], indent: str) -> str:
    return "\n".join(f"{indent}{statement.name} = {statement.expression};" for statement in statements)


def _literal(value: float) -> str:
    if math.isinf(value):
        return "Inf" if value > 0.0 else "(-Inf)"
    return repr(value) if value >= 0.0 else f"({value!r})"
