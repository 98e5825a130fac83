"""What of a study there is so far: the results found, and why others are not."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple


class FailedStep(NamedTuple):
    """A step that could not be completed, and why."""

    name: str
    reason: str


class SkippedStep(NamedTuple):
    """A step that was not begun, because others that it needs are not there."""

    name: str
    wants: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parts:
    """A study under way.

    Attributes:
        found: results, each by its field of `StudyResults`.
        finished: names of the steps that are done, in their order.
        failed: steps that could not be completed.
        skipped: steps that were not begun for want of these.
    """

    found: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    finished: tuple[str, ...] = ()
    failed: tuple[FailedStep, ...] = ()
    skipped: tuple[SkippedStep, ...] = ()

    def with_result(self, step: str, place: str, result: object) -> "Parts":
        """The parts and one more result."""
        return replace(self, found=MappingProxyType({**self.found, place: result}), finished=(*self.finished, step))

    def with_failure(self, step: str, reason: str) -> "Parts":
        """The parts, and why a step gave nothing."""
        return replace(self, failed=(*self.failed, FailedStep(step, reason)))

    def with_skipped(self, step: str, wants: tuple[str, ...]) -> "Parts":
        """The parts, and what a step would have needed."""
        return replace(self, skipped=(*self.skipped, SkippedStep(step, wants)))

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing of what was tried."""
        return not self.failed and not self.skipped

    @property
    def text(self) -> str:
        """What is missing and why, in words."""
        reasons = "; ".join(f"{step.name}: {step.reason.rstrip('.')}" for step in self.failed)
        wanting = ", ".join(step.name for step in self.skipped)
        return f"could not be completed: {reasons}" + (f"; not begun for want of that: {wanting}" if wanting else "")
