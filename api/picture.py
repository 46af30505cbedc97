"""A plan as a picture: where the robot drives, and what its wheels do meanwhile.

Matplotlib is slow to import and nobody needs it to plan, so nothing imports this module until a picture is
asked for. It is used through Figure and a canvas, never pyplot, which keeps state for the whole process.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
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
from planner.problem import Circle as DiscObstacle
from planner.problem import Environment, Footprint, MapLayer, Problem

__all__ = ["LIMIT", "draw_plan"]

INK, SOFT, FAINT = "#2d3440", "#6b7480", "#d9dde2"
WALL, UNKNOWN, FREE, SOLID = "#3c4552", "#e4e7eb", "#ffffff", "#b3bac4"
BODY, TRAIL, START, GOAL = "#2f6db3", "#e4eef8", "#2e8b57", "#c8641e"
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
SWEPT = 240
"""Most footprints that the swept area is made of, and pieces of the path"""
CORNERS = 12
"""Of footprints with so few corners the way of each side is drawn too, between half as many"""

Array = NDArray[np.float64]
Cells = NDArray[np.int8]
Box = tuple[float, float, float, float]


def draw_plan(problem: Problem, plan: Mapping[str, Any], form: Literal["svg", "png"]) -> bytes:
    """One plan as an SVG, or as a PNG 1800 pixels wide.

    plan is the answer of POST /v1/plans to the problem. Left: the environment, the path of the body origin
    coloured by speed, and the footprint at even intervals of time. Right: each wheel's rate and, below, the
    steering angles or, where nothing steers, the wheels' accelerations, with their limits dashed. Raises
    FileNotFoundError where the problem's map has been deleted.
    """
    poses = np.column_stack([np.asarray(plan["trajectory"][k], float) for k in ("x", "y", "theta")])
    outline = _outline(problem.robot.footprint)
    fixed = problem.robot.drive.fixed_body_heading
    headings = poses[:, 2] if fixed is None else np.full(len(poses), fixed)
    layer = problem.environment.map
    cells = None if layer is None else np.load(layer.directory / "cells.npy", mmap_mode="r")
    view = _view(problem.environment, cells, _placed(outline, poses, headings))

    panel_width = WIDTH - LEFT - RIGHT - GAP - SIDE
    panel_height = panel_width * (view[3] - view[1]) / (view[2] - view[0])
    wheels, steering = plan["schedule"]["wheels"], plan["schedule"]["steering"]
    labels = [_label(name) for name in wheels]
    columns = max(1, min(4, int(SIDE / (0.3 + 0.06 * max(map(len, labels))))))
    legend_rows = math.ceil(min(len(labels), len(WHEELS)) / columns)
    height = TOP + 0.19 * (legend_rows - 1) + panel_height + BOTTOM
    figure = Figure(figsize=(WIDTH, height), facecolor="white")
    FigureCanvasAgg(figure)

    def place(left: float, bottom: float, width: float, tall: float) -> Axes:
        return figure.add_axes((left / WIDTH, bottom / height, width / WIDTH, tall / height))

    floor = place(LEFT, BOTTOM, panel_width, panel_height)
    _draw_environment(floor, problem.environment, cells, view)
    period = _draw_motion(floor, plan, poses, headings, outline)
    if len(poses) > 1:
        bar = place(LEFT + panel_width - 1.7, BOTTOM + panel_height + 0.2, 1.0, 0.08)
        _draw_speed_bar(bar, _speeds(plan))

    half = (panel_height - 0.22) / 2
    side = LEFT + panel_width + GAP
    upper, lower = place(side, BOTTOM + half + 0.22, SIDE, half), place(side, BOTTOM, SIDE, half)
    limits = problem.robot.limits

    def column(of: Mapping[str, Any], key: str) -> dict[str, Array]:
        return {name: np.asarray(values[key], float) for name, values in of.items()}

    _draw_series(upper, plan, column(wheels, "velocity"), limits.wheel_speed, "wheel rate (rad/s)")
    if steering:
        allowed = np.full(len(steering), limits.steering_angle)
        _draw_series(lower, plan, column(steering, "angle"), allowed, "steering (rad)")
    else:
        accelerations = column(wheels, "acceleration")
        _draw_series(lower, plan, accelerations, limits.wheel_acceleration, "wheel accel. (rad/s²)")
    _draw_legend(upper, columns)
    _finish_columns(upper, lower, float(plan["duration"]))

    headline = BOTTOM + panel_height + 0.17
    name = problem.robot.drive.kind.replace("_", " ").capitalize()
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
    buffer = io.BytesIO()
    # Without these two an SVG would differ from one drawing to the next.
    with rc_context({"svg.hashsalt": "wheelplan"}):
        figure.savefig(buffer, dpi=DPI, format=form, metadata={"Date": None} if form == "svg" else None)
    return buffer.getvalue()


# ---------------------------------------------------------------- geometry


def _outline(footprint: Footprint) -> Array:
    """The footprint's corners (n, 2) in the body frame, m; a disc as a fine polygon."""
    if len(footprint.vertices) > 1:
        return footprint.vertices
    around = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    return footprint.vertices + footprint.radius * np.column_stack([np.cos(around), np.sin(around)])


def _placed(outline: Array, poses: Array, headings: Array) -> Array:
    """The outline at each pose: (n, corners, 2) in the world frame."""
    c, s = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x = poses[:, 0, None] + c * outline[:, 0] - s * outline[:, 1]
    y = poses[:, 1, None] + s * outline[:, 0] + c * outline[:, 1]
    return np.stack([x, y], axis=-1)


def _speeds(plan: Mapping[str, Any]) -> Array:
    return np.asarray(np.hypot(plan["trajectory"]["vx"], plan["trajectory"]["vy"]), float)


def _known_corners(layer: MapLayer, cells: Cells) -> Array:
    """Corners (4, 2), in the world frame, of the part of a map that is not all unknown at its edges."""
    rows, columns = np.nonzero(cells != UNKNOWN_CELL)
    if not rows.size:
        rows, columns = (np.array([0, n - 1]) for n in cells.shape)
    x_min, x_max = columns.min() * layer.resolution, (columns.max() + 1) * layer.resolution
    y_min, y_max = rows.min() * layer.resolution, (rows.max() + 1) * layer.resolution
    corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
    return np.asarray(_placed(corners, np.array([layer.origin]), np.array([layer.origin.theta]))[0])


def _view(environment: Environment, cells: Cells | None, footprints: Array) -> Box:
    """What the left panel shows: the whole environment, or where the motion is if that is a small part."""
    points = footprints.reshape(-1, 2)
    near_min, near_max = points.min(axis=0), points.max(axis=0)
    margin = 0.12 * float((near_max - near_min).max())
    low, high = near_min - margin, near_max + margin
    worlds = []
    if environment.map is not None and cells is not None:
        worlds.append(_known_corners(environment.map, cells))
    if (box := environment.bounds) is not None:
        worlds.append(np.array([[box.x_min, box.y_min], [box.x_max, box.y_max]], float))
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


def _draw_environment(axes: Axes, environment: Environment, cells: Cells | None, view: Box) -> None:
    axes.set_facecolor(UNKNOWN)
    layer = environment.map
    if layer is not None and cells is not None:
        tall, wide = np.array(cells.shape) * layer.resolution
        image = axes.imshow(
            cells,
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
    if (box := environment.bounds) is not None:
        corner, wide, tall = (box.x_min, box.y_min), box.x_max - box.x_min, box.y_max - box.y_min
        fill = FREE if layer is None else "none"
        axes.add_patch(
            Rectangle(corner, wide, tall, facecolor=fill, edgecolor=WALL, linewidth=1.4, zorder=0.5)
        )
    for obstacle in environment.obstacles:
        style: dict[str, Any] = {"facecolor": SOLID, "edgecolor": WALL, "linewidth": 0.9, "zorder": 1}
        if isinstance(obstacle, DiscObstacle):
            axes.add_patch(Circle((obstacle.x, obstacle.y), obstacle.radius, **style))
        else:
            axes.add_patch(Polygon(obstacle.vertices, closed=True, joinstyle="round", **style))
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

        def shapes(at: Array) -> Array:
            between = np.column_stack([np.interp(at, time, poses[:, i]) for i in range(3)])
            return _placed(outline, between, np.interp(at, time, headings))

        angular = len(outline) <= CORNERS
        swept = shapes(np.linspace(0, duration, min(SWEPT // (1 + angular), 4 * len(time))))
        ways = [swept[:-1], np.roll(swept[:-1], -1, 1), np.roll(swept[1:], -1, 1), swept[1:]]
        area = [*swept, *np.stack(ways, axis=2).reshape(-1, 4, 2)] if angular else list(swept)
        axes.add_collection(PolyCollection(area, facecolors=TRAIL, edgecolors=TRAIL, zorder=1.8))
        axes.add_collection(
            PolyCollection(
                list(shapes(at)), facecolors="none", edgecolors=BODY + "70", linewidths=0.7, zorder=2
            )
        )
        knots = np.linspace(0, duration, min(SWEPT, len(time)))
        speed = np.interp(knots, time, _speeds(plan))
        way = np.column_stack([np.interp(knots, time, poses[:, i]) for i in range(2)])
        axes.add_collection(
            LineCollection(
                list(np.stack([way[:-1], way[1:]], axis=1)),
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
    for index, colour, tint in ((0, START, "#dcefe4"), (-1, GOAL, "#fae6d7")):
        shape = _placed(outline, poses[[index]], headings[[index]])[0]
        axes.add_patch(Polygon(shape, facecolor=tint, edgecolor=colour, linewidth=1.7, zorder=2.5))
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
    axes: Axes, plan: Mapping[str, Any], series: Mapping[str, Array], limit: Array, label: str
) -> None:
    """One line for each name, in its wheel's colour, and the limits (one for each, inf: none) dashed.

    Where wheels have limits of their own, a mark in the wheel's colour says whose each is.
    """
    time = np.asarray(plan["schedule"]["time"], float)
    colours = dict(zip(plan["schedule"]["wheels"], itertools.cycle(WHEELS)))
    limits = {name: float(most) for name, most in zip(series, limit, strict=True) if math.isfinite(most)}
    for name, values in series.items():
        # Wheels that do the same share one line, each in its own dashes.
        same = [other for other in series if np.allclose(series[other], values, atol=1e-6)]
        dashes = "-" if len(same) == 1 else (6 * same.index(name), (6, 6 * (len(same) - 1)))
        axes.plot(time, values, color=colours[name], linewidth=1.3, linestyle=dashes, zorder=2)
        axes.plot([], [], color=colours[name], linewidth=1.6, label=_label(name))

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


def _label(name: str) -> str:
    short = name if len(name) <= 24 else f"{name[:11]}…{name[-12:]}"
    return short.replace("_", " ")


def _draw_legend(axes: Axes, columns: int) -> None:
    # Colours come again after these.
    axes.legend(
        *(each[: len(WHEELS)] for each in axes.get_legend_handles_labels()),
        loc="lower right",
        bbox_to_anchor=(1.012, 1.0),
        ncols=columns,
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
