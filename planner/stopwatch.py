"""Planning time: what is left of it, and what it went into."""

from __future__ import annotations

import time

__all__ = ["Stopwatch"]


class Stopwatch:
    """Planning time: what is left of the budget, and what each stage took (s)."""

    def __init__(self, budget: float) -> None:
        self._begin = self._last = time.perf_counter()
        self._budget = budget
        self._laps: dict[str, float] = {}
        self.cut_short = False
        """Whether anyone was told that it is over."""

    def is_over(self, needed: float = 0.0) -> bool:
        """Whether less than `needed` (s) is left."""
        over = time.perf_counter() - self._begin + needed >= self._budget
        self.cut_short |= over
        return over

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self._laps[stage] = self._laps.get(stage, 0.0) + now - self._last
        self._last = now

    def timings(self) -> dict[str, float]:
        return {stage: round(t, 6) for stage, t in self._laps.items()} | {
            "total": round(time.perf_counter() - self._begin, 6)
        }
