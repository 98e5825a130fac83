"""How large a box of operating points can be at most in which one set of gains holds: by proofs at a few points each.

A proof that no gains serve some points rules out every box that holds these points. A box that holds no ruled one lies within one of the
four parts that avoid it: right or left of it, above or below. So the map is divided, the largest part first, each part ruled out by a proof
inside it and divided in turn, until the largest part left is hardly larger than the box that was found: its area is the upper bound.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from revline.analysis.linearize import linearize
from revline.analysis.threads import Progress
from revline.design.maps.box_gains import CommonGains, Solver
from revline.design.maps.gain_box import BoxGains
from revline.design.maps.gain_map import Design, GainMap, GainPoint
from revline.design.maps.operating_box import CORNERS, Box
from revline.design.regions.gain_curve import LoopFamily
from revline.design.regions.gain_region import find_gain_region
from revline.design.regions.loop_family import family_of_system
from revline.design.regions.no_gains import GainBox, NoCommonGains, NoProof, Point, prove_no_gains
from revline.errors import NotConvergedError, out_of_range
from revline.system import DelaySystem

Floats = NDArray[np.float64]

SHAPES = (0.5, 1.0, 0.0)
"""How a part is drawn in to a box that is to be ruled out: in both axes alike, or in one."""

DRAWN_IN, DRAWN_IN_PER_EXCESS, HALVINGS = 0.02, 0.4, 4
"""By which part of its area a part is drawn in at least, or by less where the limit is to come near, and how often the part left is halved:
small boxes rule out most."""

SLICES = 9
"""Values of kd at which the reach of the weakest point's stabilising gains is taken."""

ROOM = 1.2
"""By this factor the box of gains exceeds that reach."""

FEWEST_LINES, MOST_LINES, LINES_PER_EXCESS = 60, 960, 12.0
"""Parts of each axis to whose lines the points of proofs are moved inwards, so that they are shared by many: the more, the nearer the limit
is to come to the found box."""

MOST_PARTS = 20_000
"""Most parts of the map that are looked at."""

FEWEST_CELLS, MOST_CELLS, CELLS_PER_EXCESS = 2_000, 20_000, 400.0
"""Most cells of one proof, likewise: where more would be needed another, larger box is easier to rule out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ruled:
    """A box of operating points that no gains serve, at some of its corners already.

    Attributes:
        box: every box that holds it is ruled out.
        places: of the points of the proof.
        floor_ki: smallest ki that the floor asks for at them.
        proof: of that.
    """

    box: Box
    places: tuple[tuple[float, float], ...]
    floor_ki: float
    proof: NoCommonGains


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxLimit:
    """No box of a larger share of the map has one set of gains that holds in it.

    Attributes:
        share: of the map's area; the found box has `found.share`, and the truth lies between.
        largest: the largest box that no proof rules out.
        kd: lowest and highest derivative gain that the proofs cover.
        ruled: the proofs.
        found: the box that was found.
        parts: of the map that were looked at.
        complete: whether the share came as near to the found one as was asked for.
    """

    share: float
    largest: Box
    kd: tuple[float, float]
    ruled: tuple[Ruled, ...]
    found: BoxGains
    parts: int
    complete: bool


def limit_boxes(
    system: DelaySystem,
    found: BoxGains,
    reference: GainMap,
    *,
    kd: tuple[float, float] | None = None,
    within: float = 0.1,
    progress: Progress | None = None,
) -> BoxLimit:
    """Prove that no box much larger than the one found has one set of gains that holds in it.

    Args:
        system: whose map it is.
        found: the box, its floor and its bound.
        reference: map whose best ki the floor refers to.
        kd: lowest and highest derivative gain to be covered; that of the found gains alone by default.
        within: how far the limit may exceed the found area, as a part of it.
        progress: told which part is done, by the limit's fall.

    Returns:
        The limit; where it stays further away than `within`, as what could not be ruled out leaves it, `complete` is false.

    Raises:
        InvalidInputError: `within` is not positive.
    """
    if not within > 0.0:
        raise out_of_range("allowed excess of the limit", within, "", "values above 0", "give one such as 0.1")
    ends = kd or (found.kd, found.kd)
    prover = _Prover(system, found, reference, ends, within)
    whole = _whole(reference)
    target = found.box.area * (1.0 + within)
    parts, ruled = [(-whole.area, whole)], list[Ruled]()
    seen, stuck = {whole}, False
    while -parts[0][0] > target and not stuck:
        left = parts[0][1]
        known = next((entry for entry in ruled if _holds(left, entry.box)), None) or prover.rule_out(left)
        stuck = known is None or len(seen) > MOST_PARTS
        if known is None or stuck:
            break
        heapq.heappop(parts)
        if known not in ruled:
            ruled.append(known)
        for part in _around(left, known.box):
            if part not in seen:
                seen.add(part)
                heapq.heappush(parts, (-part.area, part))
        if progress is not None:
            progress(min(1.0, (whole.area + parts[0][0]) / (whole.area - target)))
    largest = parts[0][1]
    share = max(found.box.area, largest.area) / whole.area
    return BoxLimit(share=share, largest=largest, kd=ends, ruled=tuple(ruled), found=found, parts=len(seen), complete=not stuck)


def _holds(box: Box, other: Box) -> bool:
    """Whether a box holds another in its inside: one with an edge in common is avoided by moving that edge by nothing."""
    return (
        box.first_low < other.first_low
        and box.first_high > other.first_high
        and box.second_low < other.second_low
        and box.second_high > other.second_high
    )


def _around(box: Box, ruled: Box) -> Iterator[Box]:
    """The largest boxes within one that do not hold a ruled one in their inside."""
    yield box._replace(first_low=ruled.first_low)
    yield box._replace(first_high=ruled.first_high)
    yield box._replace(second_low=ruled.second_low)
    yield box._replace(second_high=ruled.second_high)


def _whole(found: GainMap) -> Box:
    first, second = found.grid.first_values, found.grid.second_values
    return Box(float(first[0]), float(first[-1]), float(second[0]), float(second[-1]))


class _Prover:
    """Rules boxes out, and remembers the points it has solved."""

    def __init__(self, system: DelaySystem, found: BoxGains, reference: GainMap, kd: tuple[float, float], within: float) -> None:
        self._system, self._found, self._kd = system, found, kd
        self._lines = round(min(MOST_LINES, max(FEWEST_LINES, LINES_PER_EXCESS / within)))
        self._cells = round(min(MOST_CELLS, max(FEWEST_CELLS, CELLS_PER_EXCESS / within)))
        self._design = Design(kd=reference.kd, peak=reference.peak)
        self._solve = Solver(system, reference, self._design)
        self._largest = 1.0 - min(DRAWN_IN, DRAWN_IN_PER_EXCESS * within)
        at_found = Design(kd=found.kd, peak=found.peak)
        own = self._solve if at_found == self._design else Solver(system, reference, at_found)
        self._common = CommonGains(own, self._solve, found.floor, found.peak)
        self._whole = _whole(reference)
        self._families: dict[tuple[float, float], Point] = {}
        self._reach: dict[tuple[float, float], tuple[float, float, float]] = {}

    def rule_out(self, box: Box) -> Ruled | None:
        """Prove that as small a box as can be in the inside of one has no gains; nothing where none is found."""
        for share in SHAPES:
            best = self._within(box, share, self._largest, 2) or self._within(box, share, self._largest, 4)
            if best is None:
                continue
            corners, (low, high) = len(best.places), (0.0, self._largest)
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                smaller = self._within(box, share, middle, corners)
                low, high, best = (low, middle, smaller) if smaller else (middle, high, best)
            return best
        return None

    def _within(self, box: Box, share: float, factor: float, corners: int) -> Ruled | None:
        inner = self._shrunk(box, factor, share)
        if not (inner.first_low < inner.first_high and inner.second_low < inner.second_high):
            return None
        return self._try(inner, inner.corners[:corners])

    def _shrunk(self, box: Box, factor: float, share: float) -> Box:
        """A box in the inside of a larger one, drawn in by a share from the first axis, to lines of the lattice."""
        whole = self._whole
        first = _drawn_in((box.first_low, box.first_high), (whole.first_low, whole.first_high), factor**share, self._lines)
        second = _drawn_in((box.second_low, box.second_high), (whole.second_low, whole.second_high), factor ** (1.0 - share), self._lines)
        return Box(*first, *second)

    def _try(self, box: Box, places: tuple[tuple[float, float], ...]) -> Ruled | None:
        if self._common.exist(box, CORNERS[: len(places)]):
            return None  # sooner told so than by a proof that fails
        points = [self._solve(place) for place in places]
        if not all(isinstance(point, GainPoint) for point in points):
            return None
        best = [point.best.ki for point in points if isinstance(point, GainPoint) and point.best]
        floor = self._found.floor.at(max(best, default=0.0))
        reach = self._reach_at(places[0])
        if floor <= 0.0 or reach is None:
            return None
        kp_low, kp_high, ki_high = reach
        gains = GainBox(
            kp_low=kp_low, kp_high=kp_high, ki_low=floor, ki_high=max(ki_high, ROOM * floor), kd_low=self._kd[0], kd_high=self._kd[1]
        )
        proof = prove_no_gains([self._point(place) for place in places], gains, self._found.peak, most=self._cells)
        if isinstance(proof, NoProof):
            return None
        return Ruled(box=box, places=places, floor_ki=floor, proof=proof)

    def _point(self, place: tuple[float, float]) -> Point:
        if place not in self._families:
            point = self._solve(place)
            if not isinstance(point, GainPoint):
                raise NotConvergedError(point.reason)
            model = linearize(self._system, point.trim).model
            name = ", ".join(f"{value:g}" for value in place)

            @cache
            def family(kd: float) -> LoopFamily:
                return family_of_system(model, kd=kd, wires=self._design.wires, name=name)

            self._families[place] = Point(name, family)
        return self._families[place]

    def _reach_at(self, place: tuple[float, float]) -> tuple[float, float, float] | None:
        """Gains that hold all that stabilise a point, with room: lowest and highest kp, highest ki; nothing where these have no end."""
        if place not in self._reach:
            point = self._point(place)
            regions = [find_gain_region(point.family(float(kd))) for kd in np.unique(np.linspace(*self._kd, SLICES))]
            held = [region for region in regions if region.rim.any()]
            if not held or not all(region.bounded for region in regions):
                return None
            low = min(float(np.min(region.kp[region.rim])) for region in held)
            high = max(float(np.max(region.kp[region.rim])) for region in held)
            room = (ROOM - 1.0) * (high - low)
            self._reach[place] = low - room, high + room, ROOM * max(float(np.max(region.ki[region.rim])) for region in held)
        return self._reach[place]


def _drawn_in(ends: tuple[float, float], whole: tuple[float, float], factor: float, lines: int) -> tuple[float, float]:
    """Draw an interval in, to lines of the lattice that lie inside it; towards the map's own edge where it ends at one of them only."""
    low, high = ends
    step = (whole[1] - whole[0]) / lines
    gone = (1.0 - factor) * (high - low)
    at_low, at_high = low <= whole[0], high >= whole[1]
    share = 0.0 if at_low and not at_high else 1.0 if at_high and not at_low else 0.5
    low, high = low + share * gone, high - (1.0 - share) * gone
    first, last = int((low - whole[0]) / step), int((high - whole[0]) / step)
    first += 1 if whole[0] + first * step <= ends[0] or whole[0] + first * step < low else 0
    first += 1 if whole[0] + first * step <= ends[0] else 0
    last -= 1 if whole[0] + last * step >= ends[1] else 0
    return whole[0] + first * step, whole[0] + last * step
