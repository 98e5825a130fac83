"""The boundary by simulation: the search on a ray against known edges, and the engine against its own linear boundary."""

import math

import pytest

from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits
from revline.design.loops.outcome import Diverged, LimitCycle, Outcome, Settled
from revline.design.regions import nonlinear_boundary
from revline.design.regions.gain_region import Window, find_gain_region
from revline.design.regions.loop_family import family_of_model
from revline.design.regions.nonlinear_boundary import BoundarySearch, StepCase, _Bisection, _Ray, _rays, find_nonlinear_boundary
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, NotConvergedError, NotSettledError
from revline.lti.transfer_function import TransferFunction

SETTLED = Settled(value=0.0, steady_error=0.0, residual=0.0)
DIVERGED = Diverged(time=1.0, value=1.0, bound=1.0)
THROTTLE = Limits(0.0, 79.46)


class Edge:
    """Loops that settle below an edge; within a band about it no record shorter than `needed` decides."""

    def __init__(self, edge: float, band: float = 0.0, needed: float = math.inf) -> None:
        self.edge, self.band, self.needed, self.longest = edge, band, needed, 0.0

    def settle(self, gains: PidGains, until: float) -> Outcome:
        self.longest = max(self.longest, until)
        if abs(gains.kp / self.edge - 1.0) < self.band and until < self.needed:
            details = {"needed": self.needed} if math.isfinite(self.needed) else {}
            message = "too short"
            raise NotSettledError(message, **details)
        return SETTLED if gains.kp < self.edge else DIVERGED


def search_ray(edge: Edge, search: BoundarySearch) -> nonlinear_boundary.BoundaryPoint:
    def gains(kp: float, ki: float) -> PidGains:
        return PidGains(kp=kp, ki=ki, kd=0.0, input_unit="1", output_unit="1", rule="r", designed_on="d")

    return _Bisection(_Ray(1.0, 0.5, 3.0), gains, edge.settle, search, lambda _: None).find()


@pytest.mark.parametrize("edge", [0.06, 0.3, 0.8, 0.99, 1.05, 1.3, 3.9])
def test_an_edge_is_bracketed_within_the_tolerance(edge: float) -> None:
    found = search_ray(Edge(edge), BoundarySearch(tolerance=1e-3))
    assert found.settled < edge <= found.unsettled
    assert found.unsettled / found.settled - 1.0 <= 1e-3
    assert found.factor == pytest.approx(edge, rel=1e-3)
    assert found.undecided == ()
    assert found.observed_frequency is None


def test_what_records_do_not_decide_stays_in_the_bracket() -> None:
    """Between 0.97 and 1.03 nothing is known: the bracket's ends are outside, and close to, that band."""
    found = search_ray(Edge(1.0, band=0.03), BoundarySearch(tolerance=0.004))
    assert 0.97 / 1.002 <= found.settled <= 0.97
    assert 1.03 <= found.unsettled <= 1.03 * 1.002
    assert found.undecided
    assert all(0.97 < factor < 1.03 for factor in found.undecided)


def test_a_record_is_made_as_long_as_it_needs_to_be() -> None:
    edge = Edge(1.0, band=0.03, needed=70.0)
    found = search_ray(edge, BoundarySearch(tolerance=0.004, until=10.0, longest=100.0))
    assert found.undecided == ()
    assert edge.longest == pytest.approx(77.0)


@pytest.mark.parametrize(("edge", "words"), [(0.01, "does not settle at 0.05"), (9.0, "still settles, or does not tell, at 4 times")])
def test_a_ray_without_an_edge_says_so(edge: float, words: str) -> None:
    with pytest.raises(NotConvergedError, match=words):
        search_ray(Edge(edge), BoundarySearch())


def test_the_engine_leaves_its_linear_boundary_at_the_target() -> None:
    """A command of +60 rad/s from 25 deg ends at 30 deg, whose linear boundary the engine keeps to within the brackets."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    case = StepCase(command=60.0, limits=THROTTLE)
    found = find_nonlinear_boundary(engine, trim, case, search=BoundarySearch(rays=2, tolerance=0.05, until=15.0))
    assert found.target == pytest.approx(30.0, abs=0.01)
    assert len(found.points) == 2
    for point in found.points:
        assert point.settled < 1.0 + 0.02
        assert point.unsettled > 1.0 - 0.02
        assert isinstance(point.outcome, LimitCycle)
        assert point.observed_frequency == pytest.approx(point.frequency, rel=0.05)
    assert found.largest_difference < 0.05
    assert found.lost == ()


def test_saturation_takes_gains_away_that_the_linear_boundary_allows() -> None:
    """With kd = 0.1 and much integral action the engine ends in a large, slower cycle at gains that the linear boundary allows."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    case = StepCase(command=60.0, kd=0.1, limits=THROTTLE)
    search = BoundarySearch(rays=3, tolerance=0.1, until=15.0, longest=30.0)
    found = find_nonlinear_boundary(engine, trim, case, search=search)
    steep = found.points[1]
    assert steep.unsettled < 0.9
    assert isinstance(steep.outcome, LimitCycle)
    assert steep.observed_frequency is not None
    assert steep.observed_frequency < 0.9 * steep.frequency
    assert found.largest_difference > 0.1


def test_an_interruption_ends_the_search() -> None:
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    search = BoundarySearch(rays=2, tolerance=0.2, until=5.0, longest=10.0)
    with pytest.raises(KeyboardInterrupt):
        find_nonlinear_boundary(engine, trim, StepCase(command=60.0, limits=THROTTLE), search=search, workers=1, progress=interrupt)


def test_a_ray_that_is_lost_is_told_beside_those_found(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    whole = _Bisection.find

    def find(self: _Bisection) -> nonlinear_boundary.BoundaryPoint:
        if self.ray.kp < 2.0:
            message = "lost on purpose"
            raise NotConvergedError(message)
        return whole(self)

    monkeypatch.setattr(_Bisection, "find", find)
    search = BoundarySearch(rays=2, tolerance=0.2, until=15.0, longest=30.0)
    found = find_nonlinear_boundary(engine, trim, StepCase(command=60.0, limits=THROTTLE), search=search)
    assert len(found.points) == len(found.lost) == 1
    assert found.lost[0].reason == "lost on purpose"


def test_unfit_questions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for options, words in (
        ({"rays": 0}, r"rays = 0"),
        ({"tolerance": 0.7}, r"tolerance = 0\.7"),
        ({"until": 10.0, "longest": 5.0}, r"longest run = 5 s is outside 10 s and above"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            BoundarySearch(**options)
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    with pytest.raises(NotConvergedError, match=r"no positive gains stabilise lee1995 at 30 deg with kd = 0\.5"):
        find_nonlinear_boundary(engine, trim, StepCase(command=60.0, kd=0.5, limits=THROTTLE))
    monkeypatch.setattr(nonlinear_boundary, "DOWN", (3.0,))
    with pytest.raises(NotConvergedError, match="no ray of 1 met a boundary of lee1995; the first: the loop does not settle at 3"):
        find_nonlinear_boundary(engine, trim, StepCase(command=60.0, limits=THROTTLE), search=BoundarySearch(rays=1, longest=20.0))


def test_a_ray_that_does_not_meet_the_linear_boundary_is_named() -> None:
    """Two lags without delay set kp no upper limit: steep rays meet the boundary, flat ones never do, and none is dropped in silence."""
    lags = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034), input_unit="deg", output_unit="rad/s")
    linear = find_gain_region(family_of_model(lags), Window(kp_low=-0.1, kp_high=1.0, ki_high=40.0))
    rays, lost = _rays(linear, 16)
    assert len(rays) + len(lost) == 16
    assert rays
    assert lost
    ratio = 0.55 / 0.034  # ki/kp of the boundary 0.034 ki = 0.55 (kp + 1/12), far out
    assert all(ray.ki / ray.kp > ratio for ray in rays)
    assert all(ray.ki / ray.kp < ratio for ray in lost)
    assert all("does not meet the linear boundary" in ray.reason for ray in lost)
