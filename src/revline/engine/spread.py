"""Engines whose parameters differ from the nominal ones: what a controller must bear from one engine to the next."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from revline.engine.lee1995 import EngineParameters, lee1995_parameters
from revline.errors import out_of_range
from revline.system import DelaySystem

LARGEST: Final = 0.5
"""Largest share by which a parameter is changed."""

SPREAD: Final = (
    ("inertia", (("rotation", "inertia"),)),
    ("transport delays", (("delays", "intake_to_torque"), ("delays", "spark_to_torque"))),
    ("manifold volume", (("manifold", "volume"),)),
    ("torque", (("combustion", "torque_constant"),)),
)
"""What differs, for people, and the parameters that stand for it."""


def spread_engine(engine: DelaySystem, share: float) -> Mapping[str, DelaySystem]:
    """Build engines with one parameter each raised or lowered by a share; the lags of both channels change together.

    Args:
        engine: of Lee (1995).
        share: for example 0.1 for 10 per cent; 0 gives none.

    Returns:
        By name, such as "inertia +10 %".

    Raises:
        InvalidInputError: the share is outside 0 to 0.5, or the engine is another model.
    """
    if not (math.isfinite(share) and 0.0 <= share <= LARGEST):
        raise out_of_range("spread of the parameters", share, "", f"0 to {LARGEST:g}", "give a share, for example 0.1")
    nominal = lee1995_parameters(engine)
    if share == 0.0:
        return MappingProxyType({})
    found = {}
    for name, places in SPREAD:
        for factor in (1.0 + share, 1.0 - share):
            found[f"{name} {100.0 * (factor - 1.0):+g} %"] = engine.with_parameters(_scaled(nominal, places, factor))
    return MappingProxyType(found)


def _scaled(parameters: EngineParameters, places: tuple[tuple[str, str], ...], factor: float) -> EngineParameters:
    for section, name in places:
        part = getattr(parameters, section)
        parameters = parameters._replace(**{section: part._replace(**{name: factor * getattr(part, name)})})
    return parameters
