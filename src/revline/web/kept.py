"""Parts of views that were found already, for all pages alike: the newest asked for are kept, up to a size."""

from collections import OrderedDict
from collections.abc import Hashable, Mapping
from types import MappingProxyType
from typing import Any, Final

MEBIBYTE: Final = 2**20

POINT: Final = ("engine", "parameters", "load_n_m", "throttle_deg", "speed_rad_s")
"""Keys of a state that say which engine it is, and where it rests."""

GAINS: Final = ("kp", "ki", "kd")

STEP: Final = ("step", "command_rad_s", "load_step_n_m", "throttle_step_deg", "until_s", "low_deg", "high_deg")
"""Keys that say what is stepped, how long that is followed, and between which limits."""

OF_PART: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "point": POINT,
        "map": POINT,
        "response": (*POINT, "amplitude_deg"),
        "models": (*POINT, "amplitude_deg"),
        "peaks": (*POINT, "amplitude_deg"),
        "gains": (*POINT, "kd"),
        "contours": (*POINT, "kd"),
        "validity": POINT,
        "margins": (*POINT, *GAINS),
        "loop_roots": (*POINT, *GAINS),
        "roots": (*POINT, *GAINS, "amplitude_deg"),
        "promises": (*POINT, *GAINS, "amplitude_deg"),
        "loop": (*POINT, *GAINS, *STEP),
    }
)
"""Keys of a state that a part depends on; one that is not listed depends on all. The page has the same table, in `page/src/needs.ts`."""

Key = tuple[str, Hashable]


def key_of(part: str, entries: Mapping[str, Any]) -> Key:
    """Name a part of a state: two that depend on the same values have the same name.

    Args:
        part: its name.
        entries: the state, with its defaults.
    """
    keys = OF_PART.get(part, tuple(sorted(entries)))
    return part, tuple((key, _fixed(entries.get(key))) for key in keys)


def _fixed(value: Any) -> Hashable:
    fixed: Hashable = tuple(sorted(value.items())) if isinstance(value, Mapping) else value
    return fixed


class Kept:
    """Keeps answers, and forgets those that were not asked for the longest.

    Args:
        size: bytes of all answers at most.
    """

    def __init__(self, size: int = 24 * MEBIBYTE) -> None:
        self._room, self._size = size, 0
        self._bodies: OrderedDict[Key, bytes] = OrderedDict()

    @property
    def size(self) -> int:
        """Bytes of all answers."""
        return self._size

    def find(self, keys: Mapping[str, Key]) -> dict[str, bytes]:
        """Find what is kept.

        Args:
            keys: names of parts, by what each is to be called in the result.
        """
        found = {}
        for name, key in keys.items():
            if key in self._bodies:
                self._bodies.move_to_end(key)
                found[name] = self._bodies[key]
        return found

    def keep(self, key: Key, body: bytes) -> None:
        """Keep an answer; what does not fit beside it is forgotten."""
        self._size += len(body) - len(self._bodies.pop(key, b""))
        self._bodies[key] = body
        while self._size > self._room:
            self._size -= len(self._bodies.popitem(last=False)[1])
