"""The shortest known way of every query that anyone has solved, at whatever cost: known.json."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

from benchmarks.search.scenes import Query

__all__ = ["Known"]

_STORED = Path(__file__).with_name("known.json")


class Known:
    """Lengths (m) by scene, mobility and query, and by whom."""

    def __init__(self) -> None:
        self._all: dict[str, dict[str, dict[str, tuple[float, str]]]] = {}
        if _STORED.exists():
            self._all = json.loads(_STORED.read_text())

    def length(self, scene: str, mobility: str, query: Query) -> float | None:
        """The best length, or None where no way is known."""
        best = self._all.get(scene, {}).get(mobility, {}).get(_key(query))
        return None if best is None else best[0]

    def add(self, scene: str, mobility: str, query: Query, length: float, by: str) -> None:
        """A way that was found and holds."""
        ways = self._all.setdefault(scene, {}).setdefault(mobility, {})
        best = ways.get(_key(query))
        if best is None or length < best[0] - 1e-3:
            ways[_key(query)] = (round(length, 3), by)

    def save(self) -> None:
        """To known.json, a line for every query."""
        text = json.dumps(self._all, indent=1, sort_keys=True)
        _STORED.write_text(
            text.replace("[\n    ", "[").replace(",\n    ", ", ").replace("\n   ]", "]") + "\n"
        )


def _key(query: Query) -> str:
    """The draw, and a check that it still makes the same query."""
    poses = ",".join(f"{v:.6f}" for v in (*query.start, *query.goal))
    return f"{query.draw}-{zlib.crc32(poses.encode()):08x}"
