"""The example map: drawn the same every time, and what its description says."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from api.occupancy import FREE, OCCUPIED, UNKNOWN, DecodedMap, decode_map

EXAMPLES = Path(__file__).parents[2] / "examples"
KEPT = EXAMPLES / "warehouse"


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / "warehouse.py"))


@pytest.fixture(scope="module")
def warehouse() -> DecodedMap:
    files = [(KEPT / f"warehouse.{kind}").read_bytes() for kind in ("yaml", "pgm")]
    return decode_map(*files, 10**6)


@pytest.mark.parametrize("name", ["warehouse.pgm", "warehouse.yaml"])
def test_the_kept_map_is_the_drawn_one(script: dict[str, Any], name: str, tmp_path: Path) -> None:
    script["write"](tmp_path)
    assert (tmp_path / name).read_bytes() == (KEPT / name).read_bytes()


def test_the_hall_is_closed_and_nothing_is_known_outside(warehouse: DecodedMap) -> None:
    cells = warehouse.cells
    assert cells.shape == (320, 480)
    assert tuple(warehouse.origin) == (-2.0, -1.5, 0.0)
    rows, columns = np.nonzero(cells == OCCUPIED)
    bottom, top, left, right = rows.min(), rows.max(), columns.min(), columns.max()
    for wall in (
        cells[bottom, left:right],
        cells[top, left:right],
        cells[bottom:top, left],
        cells[bottom:top, right],
    ):
        assert (wall == OCCUPIED).all()
    outside = np.ones_like(cells, dtype=bool)
    outside[bottom : top + 1, left : right + 1] = False
    assert (cells[outside] == UNKNOWN).all()


def test_aisles_are_wide_enough(script: dict[str, Any], warehouse: DecodedMap) -> None:
    def is_free(x_min: float, y_min: float, x_max: float, y_max: float) -> bool:
        column, row, last_column, last_row = (
            round((v - o) / warehouse.resolution)
            for v, o in zip((x_min, y_min, x_max, y_max), warehouse.origin[:2] * 2, strict=True)
        )
        return bool((warehouse.cells[row:last_row, column:last_column] == FREE).all())

    assert is_free(1.6, 0.35, 15.4, 1.95)  # an aisle, 1.6 m of it
    assert is_free(1.6, 3.5, 7.4, 5.5)
    assert is_free(15.4, 2.0, 17.3, 12.0)  # the way to the dock
    assert is_free(19.2, 4.15, 20.8, 5.65)  # a bay
