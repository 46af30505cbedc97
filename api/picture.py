"""A plan as a picture: where the robot drives, and what its wheels do meanwhile.

Matplotlib is slow to import and nobody needs it to plan, so nothing imports this module until a picture is
asked for. It is used through Figure and a canvas, never pyplot, which keeps state for the whole process.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrow, Polygon, Rectangle
from matplotlib.ticker import MaxNLocator, MultipleLocator
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from api.occupancy import UNKNOWN as UNKNOWN_CELL
from api.occupancy import DecodedMap, decode_map

__all__ = ["LIMIT", "draw_plan"]

INK, SOFT, FAINT = "#2d3440", "#6b7480", "#d9dde2"
WALL, UNKNOWN, FREE, SOLID = "#3c4552", "#e4e7eb", "#ffffff", "#b3bac4"
BODY, START, GOAL = "#2f6db3", "#2e8b57", "#c8641e"
LIMIT = "#c0392b"
"""Colour of a limit, used for nothing else"""
WHEELS = ("#3a6ea5", "#d98c3f", "#4a9b6e", "#8d6cab", "#7a6a58", "#3fa7b5", "#c978a8", "#7f858d")
SPEED = LinearSegmentedColormap.from_list("speed", ["#a9cbe8", "#4f8fca", "#1c4f91", "#0c2547"])

DPI = 150
WIDTH, SIDE = 12.0, 3.9
"""Width (in) of the figure and of its right column"""
LEFT, RIGHT, TOP, BOTTOM, GAP = 0.62, 0.15, 0.62, 0.52, 0.78
"""Margins (in) around the panels and between the columns"""
ASPECTS = (1.05, 1.8)
"""Width to height of the left panel, least and most"""
OUTLINES = 24
"""Most footprints drawn between start and goal"""

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


def draw_plan(
    request: Mapping[str, Any], plan: Mapping[str, Any], path: Path, map_yaml: Path | None = None
) -> None:
    """Draw one answered request as a PNG, 1800 pixels wide.

    request and plan are the bodies of POST /v1/plans and of its answer; map_yaml is the map_server file of
    the map that the request names, without which the map is left out. Left: the environment, the path of the
    body origin coloured by speed, and the footprint at even intervals of time. Right: each wheel's rate and,
    below, the steering angles or, where nothing steers, the wheels' accelerations, with their limits dashed.
    """
    poses = np.column_stack([np.asarray(plan["trajectory"][k], float) for k in ("x", "y", "theta")])
    outline = _outline(request["robot"]["footprint"])
    headings = _body_headings(request, poses)
    layer = None if map_yaml is None else _read_map(map_yaml)
    view = _view(request["environment"], layer, _placed(outline, poses, headings))

    panel_width = WIDTH - LEFT - RIGHT - GAP - SIDE
    panel_height = panel_width * (view[3] - view[1]) / (view[2] - view[0])
    height = TOP + panel_height + BOTTOM
    figure = Figure(figsize=(WIDTH, height), facecolor="white")
    FigureCanvasAgg(figure)

    def place(left: float, bottom: float, width: float, tall: float) -> Axes:
        return figure.add_axes((left / WIDTH, bottom / height, width / WIDTH, tall / height))

    floor = place(LEFT, BOTTOM, panel_width, panel_height)
    _draw_environment(floor, request["environment"], layer, view)
    period = _draw_motion(floor, plan, poses, headings, outline)
    if len(poses) > 1:
        bar = place(LEFT + panel_width - 1.7, BOTTOM + panel_height + 0.2, 1.0, 0.08)
        _draw_speed_bar(bar, _speeds(plan))

    half = (panel_height - 0.22) / 2
    side = LEFT + panel_width + GAP
    upper, lower = place(side, BOTTOM + half + 0.22, SIDE, half), place(side, BOTTOM, SIDE, half)
    wheels, steering = plan["schedule"]["wheels"], plan["schedule"]["steering"]
    limits = request["robot"]["limits"]

    def column(of: Mapping[str, Any], key: str) -> dict[str, Sequence[float]]:
        return {name: values[key] for name, values in of.items()}

    _draw_series(upper, plan, column(wheels, "velocity"), limits["wheel_speed"], "wheel rate (rad/s)")
    if steering:
        _draw_series(lower, plan, column(steering, "angle"), limits.get("steering_angle"), "steering (rad)")
    else:
        accelerations = column(wheels, "acceleration")
        _draw_series(lower, plan, accelerations, limits["wheel_acceleration"], "wheel accel. (rad/s²)")
    _draw_legend(upper)
    _finish_columns(upper, lower, float(plan["duration"]))

    headline = BOTTOM + panel_height + 0.17
    name = str(request["robot"]["drive"]["type"]).replace("_", " ").capitalize()
    title = figure.text(LEFT / WIDTH, headline / height, name, size=14, weight="bold", color=INK)
    extent = title.get_window_extent()
    figure.text(
        (extent.x1 / figure.dpi + 0.14) / WIDTH,
        headline / height,
        f"{plan['duration']:.2f} s,  {plan['length']:.2f} m",
        size=10,
        color=SOFT,
    )
    if period is not None:
        note = f"outlines {period:g} s apart"
        figure.text((LEFT + panel_width) / WIDTH, 0.145 / height, note, size=8.5, color=SOFT, ha="right")
    figure.savefig(path, dpi=DPI, format="png")


# ---------------------------------------------------------------- geometry


def _outline(footprint: Mapping[str, Any]) -> Array:
    """The footprint's corners (n, 2) in the body frame, m; a circle as a fine polygon."""
    kind = footprint["type"]
    if kind == "circle":
        around = np.linspace(0, 2 * np.pi, 72, endpoint=False)
        return float(footprint["radius"]) * np.column_stack([np.cos(around), np.sin(around)])
    if kind == "rectangle":
        half = np.array([footprint["length"], footprint["width"]], float) / 2
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        return np.asarray(corners + np.array([footprint.get("offset", 0.0), 0.0]))
    return np.asarray(footprint["vertices"], float)


def _body_headings(request: Mapping[str, Any], poses: Array) -> Array:
    """Heading (n,) of the footprint. A synchro drive turns its wheels and leaves its body as it stands."""
    drive = request["robot"]["drive"]
    if drive["type"] != "synchro":
        return np.asarray(poses[:, 2])
    fixed = drive.get("body_heading")
    return np.full(len(poses), request["start"]["theta"] if fixed is None else fixed)


def _placed(outline: Array, poses: Array, headings: Array) -> Array:
    """The outline at each pose: (n, corners, 2) in the world frame."""
    c, s = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x = poses[:, 0, None] + c * outline[:, 0] - s * outline[:, 1]
    y = poses[:, 1, None] + s * outline[:, 0] + c * outline[:, 1]
    return np.stack([x, y], axis=-1)


def _speeds(plan: Mapping[str, Any]) -> Array:
    return np.asarray(np.hypot(plan["trajectory"]["vx"], plan["trajectory"]["vy"]), float)


def _read_map(map_yaml: Path) -> DecodedMap:
    description = map_yaml.read_bytes()
    image = map_yaml.parent / str(yaml.safe_load(description)["image"])
    return decode_map(description, image.read_bytes(), sys.maxsize)


def _known_corners(layer: DecodedMap) -> Array:
    """Corners (4, 2), in the world frame, of the part of a map that is not all unknown at its edges."""
    rows, columns = np.nonzero(layer.cells != UNKNOWN_CELL)
    if not rows.size:
        rows, columns = (np.array([0, n - 1]) for n in layer.cells.shape)
    x_min, x_max = columns.min() * layer.resolution, (columns.max() + 1) * layer.resolution
    y_min, y_max = rows.min() * layer.resolution, (rows.max() + 1) * layer.resolution
    corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
    return np.asarray(_placed(corners, np.array([layer.origin]), np.array([layer.origin.theta]))[0])


def _view(environment: Mapping[str, Any], layer: DecodedMap | None, footprints: Array) -> Box:
    """What the left panel shows: the whole environment, or where the motion is if that is a small part."""
    points = footprints.reshape(-1, 2)
    near_min, near_max = points.min(axis=0), points.max(axis=0)
    margin = 0.12 * float((near_max - near_min).max())
    low, high = near_min - margin, near_max + margin
    worlds = [] if layer is None else [_known_corners(layer)]
    if (bounds := environment.get("bounds")) is not None:
        worlds.append(
            np.array([[bounds["x_min"], bounds["y_min"]], [bounds["x_max"], bounds["y_max"]]], float)
        )
    if worlds:
        world_low = np.max([w.min(axis=0) for w in worlds], axis=0)
        world_high = np.min([w.max(axis=0) for w in worlds], axis=0)
        if float(np.max((high - low) / (world_high - world_low))) > 0.5:
            edge = 0.015 * float((world_high - world_low).max())
            low, high = (
                np.minimum(low + margin, world_low - edge),
                np.maximum(high - margin, world_high + edge),
            )
    width, height = high - low
    wider = max(0.0, ASPECTS[0] * height - width) / 2
    taller = max(0.0, width / ASPECTS[1] - height) / 2
    return float(low[0] - wider), float(low[1] - taller), float(high[0] + wider), float(high[1] + taller)


# ---------------------------------------------------------------- left panel


def _draw_environment(
    axes: Axes, environment: Mapping[str, Any], layer: DecodedMap | None, view: Box
) -> None:
    axes.set_facecolor(UNKNOWN)
    if layer is not None:
        tall, wide = np.array(layer.cells.shape) * layer.resolution
        image = axes.imshow(
            layer.cells,
            cmap=ListedColormap([FREE, WALL, UNKNOWN]),
            vmin=0,
            vmax=2,
            origin="lower",
            extent=(0, wide, 0, tall),
            interpolation="nearest",
            zorder=0,
        )
        x, y, yaw = layer.origin
        image.set_transform(Affine2D().rotate(yaw).translate(x, y) + axes.transData)
    if (bounds := environment.get("bounds")) is not None:
        corner = bounds["x_min"], bounds["y_min"]
        wide, tall = bounds["x_max"] - corner[0], bounds["y_max"] - corner[1]
        fill = FREE if layer is None else "none"
        axes.add_patch(
            Rectangle(corner, wide, tall, facecolor=fill, edgecolor=WALL, linewidth=1.4, zorder=0.5)
        )
    for obstacle in environment.get("obstacles") or []:
        style: dict[str, Any] = {"facecolor": SOLID, "edgecolor": WALL, "linewidth": 0.9, "zorder": 1}
        if obstacle["type"] == "circle":
            axes.add_patch(Circle(obstacle["center"], obstacle["radius"], **style))
        else:
            axes.add_patch(Polygon(obstacle["vertices"], closed=True, joinstyle="round", **style))
    axes.set(xlim=(view[0], view[2]), ylim=(view[1], view[3]), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    step = _round_up((view[2] - view[0]) / 12)
    axes.xaxis.set_major_locator(MultipleLocator(step))
    axes.yaxis.set_major_locator(MultipleLocator(step))
    _style(axes)


def _draw_motion(
    axes: Axes, plan: Mapping[str, Any], poses: Array, headings: Array, outline: Array
) -> float | None:
    """Path, outlines, start and goal; the period (s) of the outlines, None where the robot stays put."""
    duration, time = float(plan["duration"]), np.asarray(plan["schedule"]["time"], float)
    period = None
    if len(poses) > 1:
        period = _round_up(duration / OUTLINES)
        at = np.arange(period, duration - period / 3, period)
        between = np.column_stack([np.interp(at, time, poses[:, i]) for i in range(3)])
        shapes = _placed(outline, between, np.interp(at, time, headings))
        axes.add_collection(
            PolyCollection(list(shapes), facecolors="none", edgecolors=BODY + "70", linewidths=0.7, zorder=2)
        )
        speed = _speeds(plan)
        pieces = np.stack([poses[:-1, :2], poses[1:, :2]], axis=1)
        axes.add_collection(
            LineCollection(
                list(pieces),
                array=(speed[1:] + speed[:-1]) / 2,
                cmap=SPEED,
                norm=Normalize(0, max(float(speed.max()), 1e-9)),
                linewidths=2.2,
                capstyle="round",
                zorder=3,
            )
        )
    # The arrow stays readable where the robot is small on a large floor.
    reach = max(float(np.hypot(*outline.T).max()), 0.035 * float(np.ptp(axes.get_xlim())))
    for index, colour in ((0, START), (-1, GOAL)):
        shape = _placed(outline, poses[[index]], headings[[index]])[0]
        axes.add_patch(Polygon(shape, facecolor=colour + "1f", edgecolor=colour, linewidth=1.7, zorder=4))
        x, y, theta = poses[index]
        axes.add_patch(
            FancyArrow(
                x,
                y,
                0.8 * reach * math.cos(theta),
                0.8 * reach * math.sin(theta),
                width=0.07 * reach,
                head_width=0.3 * reach,
                head_length=0.3 * reach,
                length_includes_head=True,
                color=colour,
                linewidth=0,
                zorder=5,
            )
        )
        axes.plot(x, y, "o", markersize=3.2, color=colour, zorder=5)
    return period


def _round_up(value: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is at least the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9))


def _draw_speed_bar(axes: Axes, speed: Array) -> None:
    axes.imshow(np.linspace(0, 1, 256)[None], cmap=SPEED, aspect="auto", extent=(0, 1, 0, 1))
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.text(-0.05, 0.4, "speed  0", ha="right", va="center", size=8.5, color=SOFT)
    axes.text(1.7, 0.4, f"{speed.max():.2f} m/s", ha="right", va="center", size=8.5, color=SOFT)


# ---------------------------------------------------------------- right column


def _draw_series(
    axes: Axes, plan: Mapping[str, Any], series: Mapping[str, Sequence[float]], limit: Any, label: str
) -> None:
    """One line for each name, in its wheel's colour, and the limits dashed.

    limit is the contract's: a number for every wheel or one for each name, or None. Where wheels have limits
    of their own, a mark in the wheel's colour says whose each is.
    """
    time = np.asarray(plan["schedule"]["time"], float)
    colours = dict(zip(plan["schedule"]["wheels"], itertools.cycle(WHEELS)))
    named = limit if isinstance(limit, Mapping) else dict.fromkeys(series, limit)
    limits = {name: float(named[name]) for name in series if named.get(name) is not None}
    for name, values in series.items():
        # Wheels that do the same share one line, each in its own dashes.
        same = [other for other in series if np.allclose(series[other], values, atol=1e-6)]
        dashes = "-" if len(same) == 1 else (6 * same.index(name), (6, 6 * (len(same) - 1)))
        axes.plot(time, values, color=colours[name], linewidth=1.3, linestyle=dashes, zorder=2)
        axes.plot([], [], color=colours[name], linewidth=1.6, label=name.replace("_", " "))

    low, high = min(map(min, series.values())), max(map(max, series.values()))
    largest = max([*limits.values(), abs(low), abs(high), 1e-9])
    two_sided = low < -0.02 * largest
    for value in set(limits.values()):
        for bound in (value, -value) if two_sided else (value,):
            axes.axhline(bound, color=LIMIT, linestyle=(0, (5, 3)), linewidth=1.1, zorder=1.5)
    if len(set(limits.values())) > 1:
        for name, value in limits.items():
            axes.plot(time[-1], value, "<", markersize=5, color=colours[name], clip_on=False, zorder=3)
    if limits:
        right = axes.get_yaxis_transform()
        axes.text(0.99, largest, "limit", ha="right", va="bottom", size=7.5, color=LIMIT, transform=right)
        low, high = -largest if two_sided else 0.0, largest
    room = 0.08 * max(high - low, 1e-3)
    axes.set_ylim(low - room, high + room)
    axes.set_ylabel(label)


def _draw_legend(axes: Axes) -> None:
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.012, 1.0),
        ncols=4,
        frameon=False,
        fontsize=8.5,
        handlelength=1.1,
        handletextpad=0.45,
        columnspacing=1.0,
        borderpad=0.1,
        labelcolor=SOFT,
    )


def _finish_columns(upper: Axes, lower: Axes, duration: float) -> None:
    for axes in (upper, lower):
        _style(axes)
        axes.set_xlim(0, max(duration, 1e-3))
        axes.axhline(0, color=FAINT, linewidth=0.9, zorder=0.5)
        axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        axes.yaxis.set_label_coords(-0.105, 0.5)
    upper.tick_params(labelbottom=False)
    lower.set_xlabel("time (s)")


def _style(axes: Axes) -> None:
    for spine in axes.spines.values():
        spine.set(color=FAINT, linewidth=0.9)
    axes.tick_params(colors=SOFT, labelsize=8.5, length=3, width=0.8)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(color=INK, size=9)
