"""Planning time: what is left of it, and what it went into."""

from __future__ import annotations

import time

from planner.kernels import compiling

__all__ = ["Stopwatch", "now"]


def now() -> float:
    """A clock that stands still while this thread waits for kernels to be compiled or loaded, s."""
    return time.perf_counter() - compiling()


class Stopwatch:
    """Planning time: what is left of the budget, and what each stage took (s)."""

    def __init__(self, budget: float) -> None:
        self._begin = self._last = now()
        self._budget = budget
        self._laps: dict[str, float] = {}
        self.cut_short = False
        """Whether anyone was told that it is over."""

    def is_over(self, needed: float = 0.0) -> bool:
        """Whether less than `needed` (s) is left."""
        over = now() - self._begin + needed >= self._budget
        self.cut_short |= over
        return over

    def lap(self, stage: str) -> None:
        reached = now()
        self._laps[stage] = self._laps.get(stage, 0.0) + reached - self._last
        self._last = reached

    def timings(self) -> dict[str, float]:
        return {stage: round(t, 6) for stage, t in self._laps.items()} | {
            "total": round(now() - self._begin, 6)
        }
