"""Why there is no plan.

    PlanningError
    ├── InvalidGeometry         a footprint, obstacle or drive that is degenerate
    ├── PoseInCollision         start or goal overlaps an obstacle (or comes nearer than min_clearance)
    ├── PoseOutOfBounds         start or goal leaves the bounds or the map
    ├── NoPathExists            proven
    ├── NoPathFound             the time budget ended first
    ├── LimitsInfeasible        no motion meets the limits
    │   └── TooManySamples      the motion takes more samples than a plan may have
    └── AuditFailed             the plan did not pass its own check

Each has a stable `code` (the contract's) and `details`, plain JSON values that belong in the answer.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from drives.se2 import Pose

__all__ = [
    "AuditFailed", "InvalidGeometry", "LimitsInfeasible", "NoPathExists", "NoPathFound", "PlanningError",
    "PoseInCollision", "PoseOutOfBounds", "TooManySamples",
]  # fmt: skip


class PlanningError(Exception):
    """Base of all planning failures. `code` is stable; `details` holds JSON values that belong in the
    answer."""

    code: str = "planning-error"

    def __init__(self, message: str, **details: Any) -> None:
        super().__init__(message)
        self.message = message
        self.details = details

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.message, self.code, self.details)


def _rebuild(cls: type[PlanningError], message: str, code: str, details: dict[str, Any]) -> PlanningError:
    error = cls.__new__(cls)
    PlanningError.__init__(error, message, **details)
    error.code = code
    return error


class InvalidGeometry(PlanningError):
    """`pointer` is the JSON pointer of the shape at fault."""

    code = "invalid-geometry"

    def __init__(self, message: str, pointer: str) -> None:
        super().__init__(message, errors=[{"pointer": pointer, "detail": message}])


class _PoseError(PlanningError):
    reason: ClassVar[str]

    def __init__(self, which: Literal["start", "goal"], message: str, pose: Pose, **details: Any) -> None:
        super().__init__(message, pose={"x": pose.x, "y": pose.y, "theta": pose.theta}, **details)
        self.code = f"{which}-{self.reason}"


class PoseInCollision(_PoseError):
    """`clearance` (m) is negative: how deep."""

    reason = "in-collision"

    def __init__(self, which: Literal["start", "goal"], message: str, pose: Pose, clearance: float) -> None:
        super().__init__(which, message, pose, clearance=clearance)


class PoseOutOfBounds(_PoseError):
    reason = "out-of-bounds"


class NoPathExists(PlanningError):
    """`proof` says how it is known."""

    code = "no-path-exists"

    def __init__(self, message: str, proof: dict[str, Any]) -> None:
        super().__init__(message, proof=proof)


class NoPathFound(PlanningError):
    """`tried` says what was; `nearest` is the pose nearest to the goal that a search came to, if any."""

    code = "no-path-found"

    def __init__(
        self, message: str, tried: list[dict[str, Any]], nearest: dict[str, float] | None = None
    ) -> None:
        super().__init__(message, tried=tried, **({} if nearest is None else {"nearest": nearest}))


class LimitsInfeasible(PlanningError):
    code = "limits-infeasible"


class TooManySamples(LimitsInfeasible):
    """A motion of `duration` s has more than `max_samples` samples of `sample_period` s."""

    code = "too-many-samples"

    def __init__(self, duration: float, sample_period: float, max_samples: int) -> None:
        super().__init__(
            f"the motion takes {duration:.6g} s; a plan has at most {max_samples} samples of "
            f"{sample_period:g} s, {max_samples * sample_period:.6g} s",
            duration=duration, sample_period=sample_period, max_samples=max_samples,
        )  # fmt: skip


class AuditFailed(PlanningError):
    """`certificate` is what the check found, `violations` the sentences."""

    code = "audit-failed"

    def __init__(self, message: str, certificate: dict[str, float], violations: list[str]) -> None:
        super().__init__(message, certificate=certificate, violations=violations)
