"""Draws the warehouse of the examples: warehouse/warehouse.pgm and its map_server yaml.

    python examples/warehouse.py [FOLDER]        default: examples/warehouse, where the drawn pair is kept

The map looks like one that a robot made by driving round: a wall or a rack is a thin dark outline, and what
no laser ever saw (inside a rack, outside the walls) is unknown. Drawing it again gives the same bytes, so
plans made on it can be compared from one version to the next.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

RESOLUTION = 0.05
"""m a cell"""
ORIGIN = (-2.0, -1.5)
"""World position (m) of the map's lower left corner. Not zero, as a map rarely begins where its robot did."""
WIDTH, HEIGHT = 480, 320
"""Cells: 24 m by 16 m"""

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
"""The grey levels that map_saver writes. 205 is unknown only because free_thresh is 0.196: at the 0.25 that
is often seen beside it, (255 - 205)/255 = 0.1961 would count as free."""

YAML = f"""\
image: warehouse.pgm
mode: trinary
resolution: {RESOLUTION}
origin: [{ORIGIN[0]}, {ORIGIN[1]}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""

WALL = 0.15
"""Thickness (m) of a wall"""

Box = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max in the world, m"""

HALL: Box = (-1.0, -0.5, 21.0, 13.5)
OFFICE: Box = (-1.0, 10.9, 2.4, 13.5)
RACKS: list[Box] = [
    # three double rows, cut by the middle cross aisle; the aisles between them are 2.0 m wide
    *((x_min, y, x_max, y + 1.2) for y in (2.3, 5.5, 8.7) for x_min, x_max in ((1.6, 7.4), (10.2, 15.4))),
    # single rows along the two long walls
    (1.6, -0.35, 15.4, 0.3),
    (4.4, 12.7, 15.4, 13.35),
]
COLUMNS: list[Box] = [(x, y, x + 0.35, y + 0.35) for x in (17.35,) for y in (2.75, 9.15)]
DOCK: list[Box] = [
    # walls that make two bays, 1.6 m wide and 1.7 m deep, against the east wall
    *((19.15, y, 20.85, y + WALL) for y in (3.95, 5.7, 7.45)),
]
PALLETS: list[tuple[float, float, float]] = [
    # centre x, y and yaw of 1.2 × 0.8 m; set down by hand, so some stand askew
    (16.3, 0.45, 0.0),
    (17.85, 0.55, 0.3),
    (19.5, 0.45, 0.0),
    (20.25, 1.85, 1.35),
    (17.1, 12.55, 0.0),
    (18.7, 12.3, -0.35),
    (20.3, 11.3, 1.5708),
    (4.6, 7.2, 0.0),
    (11.9, 11.75, 0.45),
    (13.1, 8.2, 0.0),
    (-0.35, 4.4, 1.5708),
    (8.8, 3.3, 0.8),
]

Mask = NDArray[np.bool_]


def draw() -> NDArray[np.uint8]:
    """The map's grey levels (HEIGHT, WIDTH), row 0 at the top as in an image file."""
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    # World position of each cell's centre; the drawing below has y upwards, the image is flipped at the end.
    x = ORIGIN[0] + (columns + 0.5) * RESOLUTION
    y = ORIGIN[1] + (rows + 0.5) * RESOLUTION
    grey = np.full((HEIGHT, WIDTH), UNKNOWN, dtype=np.uint8)

    def within(box: Box, margin: float = 0.0) -> Mask:
        x_min, y_min, x_max, y_max = box
        inside_x = (x > x_min + margin) & (x < x_max - margin)
        inside: Mask = inside_x & (y > y_min + margin) & (y < y_max - margin)
        return inside

    def outline(box: Box, thickness: float) -> None:
        grey[within(box)] = OCCUPIED
        grey[within(box, thickness)] = UNKNOWN

    grey[within(HALL)] = OCCUPIED
    grey[within(HALL, WALL)] = FREE
    outline(OFFICE, WALL)
    for rack in RACKS:
        outline(rack, 2 * RESOLUTION)
    for solid in (*COLUMNS, *DOCK):
        grey[within(solid)] = OCCUPIED
    for centre_x, centre_y, yaw in PALLETS:
        c, s = math.cos(yaw), math.sin(yaw)
        along = c * (x - centre_x) + s * (y - centre_y)
        across = -s * (x - centre_x) + c * (y - centre_y)
        grey[(np.abs(along) < 0.6) & (np.abs(across) < 0.4)] = OCCUPIED
    return grey[::-1]


def write(folder: Path) -> None:
    """Write warehouse.pgm (binary, P5) and warehouse.yaml into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    header = f"P5\n{WIDTH} {HEIGHT}\n255\n".encode()
    (folder / "warehouse.pgm").write_bytes(header + draw().tobytes())
    (folder / "warehouse.yaml").write_text(YAML, newline="\n")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "warehouse")
