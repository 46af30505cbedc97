"""What is printed: quantiles of times, lengths against the best known, and where the time goes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.search.ours import Ours

__all__ = ["HEADER", "list_slow", "list_stages", "milliseconds", "ratios", "row"]

_STAGES = ("prepare", "search", "shorten", "time", "schedule", "verify")

HEADER = (
    f"{'scene':9}{'mobility':13}{'who':16}{'solved':>10}{'in 1 s':>8}{'250 ms':>8}{'median':>10}{'95 %':>10}"
    f"{'99 %':>10}{'worst':>10}{'length':>9}{'motions/s':>11}"
)


def milliseconds(seconds: float) -> str:
    """Fixed width; a time that never came is a miss."""
    if not np.isfinite(seconds):
        return f"{'missed':>10}"
    return f"{seconds * 1e3:7.{1 if seconds < 1 else 0}f} ms"


def row(
    scene: str,
    mobility: str,
    who: str,
    times: Sequence[float],
    lengths: Iterable[tuple[float, float]] = (),
    speed: float = np.nan,
) -> str:
    """times s: of the solvable queries, inf where one was missed; lengths: pairs of found and best known;
    speed: motions checked per second."""
    t = np.array(times)
    n = len(t)
    line = f"{scene:9}{mobility:13}{who:16}{np.isfinite(t).sum():5}/{n:4}"
    for limit in (1.0, 0.25):
        line += f"{(t <= limit).mean() * 100 if n else 0:6.1f} %"
    for q in (0.5, 0.95, 0.99, 1.0):
        line += milliseconds(float(np.quantile(t, q, method="higher"))) if n else " " * 10
    ratio = [found / best for found, best in lengths if best > 0]
    line += f"{np.median(ratio):9.3f}" if ratio else " " * 9
    return line + (f"{speed:11,.0f}" if np.isfinite(speed) else "")


def ratios(
    plan: Sequence[float], path: Sequence[float], first: Sequence[float], total: Sequence[float]
) -> str:
    """Of the medians: of whole plans, and of their paths alone, to native's paths."""
    a, b, c, d = (float(np.median(t)) for t in (plan, path, first, total))
    if not np.isfinite([a, b, c, d]).all():
        return f"{'':22}planner / native: no ratio, one of them missed half the queries"
    simple, plain = f"{a / d:.2f} ({b / d:.2f})", f"{a / c:.2f} ({b / c:.2f})"
    return f"{'':22}planner (its path alone) / native: {simple} with simplify, {plain} without"


def list_stages(plans: Sequence[Ours]) -> str:
    """Median (mean) ms of every stage, and who found the ways."""
    solved = [p for p in plans if p.solved]
    if not solved:
        return ""
    parts = []
    for stage in _STAGES:
        took = 1e3 * np.array([p.stages.get(stage, 0.0) for p in solved])
        parts.append(f"{stage} {np.median(took):.1f} ({took.mean():.1f})")
    by = ", ".join(f"{name} {count}" for name, count in Counter(p.by for p in solved).most_common())
    return f"{'':22}ms: {', '.join(parts)}; by {by}"


def list_slow(plans: Sequence[tuple[int, Ours]], limit: float = 0.25, most: int = 12) -> list[str]:
    """The solvable queries, by draw, that were missed or took longer than limit s."""
    slow = sorted((p for p in plans if not p[1].solved or p[1].total > limit), key=lambda p: -p[1].total)
    lines = [f"{'':22}draw {draw}: {p.total:.2f} s, {p.by[:90]}" for draw, p in slow[:most]]
    return lines + ([f"{'':22}and {len(slow) - most} more"] if len(slow) > most else [])
