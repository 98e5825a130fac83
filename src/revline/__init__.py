"""revline: engine models with transport delay, from nonlinear simulation to proven controllers, with the delay exact.

What `__all__` names is public. Each name is imported from its module when it is first used, so that `import revline` costs
next to nothing; the table below says from where, and the imports under TYPE_CHECKING say the same to type checkers.
"""

import importlib
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from revline.engine.lee1995 import lee1995
    from revline.equations import equation
    from revline.errors import (
        AnalysisError,
        DivergedError,
        InvalidInputError,
        LagError,
        NotConvergedError,
        NoTrimError,
        NotSettledError,
        PartialResultError,
        RevlineError,
        SimulationError,
        StalledError,
        StepError,
    )
    from revline.system import DelaySystem, Plant, Variable
    from revline.units import rpm_to_speed, speed_to_rpm

__all__ = (
    "AnalysisError",
    "DelaySystem",
    "DivergedError",
    "InvalidInputError",
    "LagError",
    "NoTrimError",
    "NotConvergedError",
    "NotSettledError",
    "PartialResultError",
    "Plant",
    "RevlineError",
    "SimulationError",
    "StalledError",
    "StepError",
    "Variable",
    "equation",
    "lee1995",
    "rpm_to_speed",
    "speed_to_rpm",
)

__version__ = "0.1.0"

_HOMES = MappingProxyType(
    {
        "revline.engine.lee1995": ("lee1995",),
        "revline.equations": ("equation",),
        "revline.errors": (
            "AnalysisError",
            "DivergedError",
            "InvalidInputError",
            "LagError",
            "NoTrimError",
            "NotConvergedError",
            "NotSettledError",
            "PartialResultError",
            "RevlineError",
            "SimulationError",
            "StalledError",
            "StepError",
        ),
        "revline.system": ("DelaySystem", "Plant", "Variable"),
        "revline.units": ("rpm_to_speed", "speed_to_rpm"),
    }
)
"""Module of each public name."""


if not TYPE_CHECKING:  # so that type checkers refuse a name that does not exist

    def __getattr__(name: str) -> object:
        for home, names in _HOMES.items():
            if name in names:
                return getattr(importlib.import_module(home), name)
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
