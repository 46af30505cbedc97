"""What is kept beside a map: the same as what is computed, and never trusted without a check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drives.se2 import Array, Pose
from planner import environment, kept
from planner.environment import CollisionWorld, prepare_map
from planner.problem import Circle, Environment, Footprint, MapLayer

ROBOT = Footprint(np.array([[0.2, 0.1], [-0.2, 0.1], [-0.2, -0.1], [0.2, -0.1]]))


@pytest.fixture
def layer(tmp_path: Path) -> MapLayer:
    cells = np.random.default_rng(3).choice(3, (70, 90), p=[0.9, 0.05, 0.05]).astype(np.int8)
    np.save(tmp_path / "cells.npy", cells)
    return MapLayer("town", tmp_path, 0.1, Pose(2.0, -1.0, 0.4))


def world(layer: MapLayer) -> Array:
    """All that planning knows, by a process that has not seen the map."""
    environment._map_ground.cache_clear()
    made = CollisionWorld.build(Environment(map=layer, obstacles=(Circle(4.0, 3.0, 0.2),)), ROBOT)
    return made.kernel


@pytest.fixture
def computations(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Grows by one each time that a map's outlines are computed."""
    done: list[str] = []
    compute = environment._outlines
    monkeypatch.setattr(environment, "_outlines", lambda *a: done.append("computed") or compute(*a))
    return done


@pytest.mark.parametrize("unknown", ["occupied", "free"])
def test_what_is_kept_is_what_would_be_computed(
    layer: MapLayer, unknown: str, computations: list[str]
) -> None:
    read = replace(layer, unknown=unknown)  # type: ignore[arg-type]
    computed = world(read)
    prepare_map(layer)
    computations.clear()
    np.testing.assert_array_equal(world(read), computed)
    assert computations == []


def test_without_unknown_cells_both_readings_are_computed_once(
    layer: MapLayer, computations: list[str]
) -> None:
    cells = np.load(layer.directory / "cells.npy")
    np.save(layer.directory / "cells.npy", np.minimum(cells, 1))
    prepare_map(layer)
    assert len(computations) == 1
    np.testing.assert_array_equal(world(layer), world(replace(layer, unknown="free")))
    assert len(computations) == 1


def test_it_is_mapped_and_cannot_be_written_to(layer: MapLayer) -> None:
    prepare_map(layer)
    found = kept.recall(layer, (70, 90), (70, 90))
    assert found is not None
    for array in found:
        assert not array.flags.writeable
        assert not array.flags.owndata
    assert sorted(p.name for p in layer.directory.iterdir()) == [
        "cells.npy", "ground-free.npy", "ground-occupied.npy",
    ]  # fmt: skip


def _changed(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[-3] ^= 1
    file.write_bytes(data)


def _older(file: Path) -> None:
    numbers = np.load(file)
    numbers[0] += 1.0
    np.save(file, numbers)


@pytest.mark.parametrize(
    "harm",
    [
        Path.unlink,
        _changed,
        _older,
        lambda file: file.write_bytes(b""),
        lambda file: file.write_bytes(b"no array"),
        lambda file: file.write_bytes(file.read_bytes()[:-800]),
        lambda file: np.save(file, np.load(file)[:100]),
        lambda file: np.save(file, np.load(file)[None]),
        lambda file: np.save(file, np.load(file).view(np.int64)),
        lambda file: np.save(file, np.array([{}]), allow_pickle=True),
        lambda file: (file.parent / "ground-free.npy").replace(file),
    ],
)
def test_what_is_not_whole_is_computed(
    layer: MapLayer, harm: Callable[[Path], None], computations: list[str]
) -> None:
    computed = world(layer)
    prepare_map(layer)
    harm(layer.directory / "ground-occupied.npy")
    computations.clear()
    np.testing.assert_array_equal(world(layer), computed)
    assert len(computations) == 1


def test_what_is_kept_of_another_map_or_version_is_computed(
    layer: MapLayer, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare_map(layer)
    cells, field = (70, 90), (70, 90)
    assert kept.recall(layer, cells, field) is not None
    assert kept.recall(replace(layer, id="village"), cells, field) is None
    assert kept.recall(replace(layer, resolution=0.2), cells, field) is None
    assert kept.recall(layer, (90, 70), field) is None
    assert kept.recall(layer, cells, (35, 45)) is None
    monkeypatch.setattr(kept, "_VERSION", kept._VERSION + 1)
    assert kept.recall(layer, cells, field) is None
