"""Which shortcuts are considered, however long the path is."""

from __future__ import annotations

import numpy as np
import pytest

from drives.se2 import Pose
from planner.path import LinePiece
from planner.shorten import _ahead, _stations


@pytest.mark.parametrize("span", [1, 3, 50])
def test_pairs_are_all_those_whose_second_is_ahead_by_no_more_than_the_span(span: int) -> None:
    station = np.concatenate([np.arange(40), np.arange(1, 39), np.arange(1, 39)])
    ahead = station[None] - station[:, None]
    expected = set(zip(*(i.tolist() for i in np.nonzero((ahead > 0) & (ahead <= span))), strict=True))
    first, second = _ahead(station, span)
    assert len(first) == len(expected)
    assert set(zip(first.tolist(), second.tolist(), strict=True)) == expected


def test_a_path_of_a_thousand_kilometres_has_no_more_stations_than_can_be_compared() -> None:
    stations, parts = _stations((LinePiece(Pose(0, 0, 0), Pose(1e6, 0, 0)),))
    assert len(stations) == len(parts) + 1 <= 1001
    assert stations[-1].tolist() == [1e6, 0, 0]
