"""Footprint against world along whole edges, compiled.

Edges are checked by conservative advancement (Mirtich, 1996): two convex pieces that lie d apart along n
cannot meet before an end point of the moving one has moved d along n. So sliding along a wall, however close,
takes no more steps than open space does, and nothing is skipped between them.

A valid edge is valid everywhere on it, ends included. An edge not decided in 100,000 steps counts as a hit.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.collision import (
    BODY,
    BOX_X,
    BOX_Y,
    CONTACT,
    DISCS,
    FIELD,
    HALF_X,
    HALF_Y,
    HEADING,
    MIN_CLEARANCE,
    RADIUS,
    REACH,
    SOLIDS,
    WALLS,
    World,
    clear,
    field_bounds,
    footprint_heading,
    in_body,
    to_local,
)
from planner.kernels import kernel
from planner.tree import HEAD, SIZE, closest

__all__ = ["linear_free", "polyline_free", "twist_free"]

_MAX_STEPS = 100_000


@kernel
def _first_contact(gap: float, speed: float, acceleration: float) -> float:
    """The first time at which speed·t + acceleration·t²/2 can reach a gap >= 0; acceleration >= 0."""
    root = math.sqrt(speed * speed + 2.0 * acceleration * gap)
    if speed >= 0.0:
        return 2.0 * gap / (speed + root) if speed + root > 0.0 else np.inf
    return (root - speed) / acceleration if acceleration > 0.0 else np.inf


@kernel
def _advance_segment(
    world: World, ax: float, ay: float, bx: float, by: float, near: float,
    vx: float, vy: float, turn: float, bend: float, top: float, time: float,
) -> float:  # fmt: skip
    """_advance against the one segment ab, in the body frame, for contact at a distance `near`."""
    x_min, x_max, y_min, y_max = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    i, stop = int(world[BODY]), int(world[DISCS])
    while i < stop:
        far = near + max(top * time, CONTACT)
        dx = max(world[i] - x_max, 0.0, x_min - world[i + 2])
        dy = max(world[i + 1] - y_max, 0.0, y_min - world[i + 3])
        if dx * dx + dy * dy > far * far:
            i += int(world[i + 4])
            continue
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            square, px, py, qx, qy = closest(
                world[i], world[i + 1], world[i + 2], world[i + 3], ax, ay, bx, by
            )
            i += SIZE
            d = math.sqrt(square)
            if not d - near > CONTACT:
                return 0.0
            if d - near >= top * time:
                continue
            nx, ny = (qx - px) / d, (qy - py) / d
            for k in (i - SIZE, i - SIZE + 2):
                ex, ey = world[k], world[k + 1]
                ux, uy = vx - turn * ey, vy + turn * ex
                # Along a side, displacement is affine in the point: its two ends bound all of it.
                gap = d - near + max(0.0, nx * (px - ex) + ny * (py - ey))
                pull = turn * turn * math.sqrt(ex * ex + ey * ey)
                if bend != 0.0:
                    pull = abs(bend) * math.sqrt(ux * ux + uy * uy)
                time = min(time, _first_contact(gap, nx * ux + ny * uy, pull))
    return time


@kernel
def _advance(
    world: World,
    x: float,
    y: float,
    c: float,
    s: float,
    vx: float,
    vy: float,
    turn: float,
    bend: float,
    time: float,
) -> float:
    """How long, up to `time`, the footprint surely moves without contact; 0 when it is in contact.

    (vx, vy, turn): its twist now, in its own frame; bend: the rate at which the origin's velocity turns."""
    margin = world[RADIUS] + world[MIN_CLEARANCE]
    box_x, box_y, half_x, half_y = world[BOX_X], world[BOX_Y], world[HALF_X], world[HALF_Y]
    speed = math.sqrt(vx * vx + vy * vy)
    spin = abs(turn) * world[REACH]
    loose = margin + CONTACT + spin * time + 0.5 * abs(bend) * speed * time * time
    mx, my = x + c * box_x - s * box_y, y + s * box_x + c * box_y
    ex, ey = abs(c) * half_x + abs(s) * half_y + loose, abs(s) * half_x + abs(c) * half_y + loose
    wx, wy = (c * vx - s * vy) * time, (s * vx + c * vy) * time
    x_min, x_max = mx - ex + min(wx, 0.0), mx + ex + max(wx, 0.0)
    y_min, y_max = my - ey + min(wy, 0.0), my + ey + max(wy, 0.0)
    i, stop = int(world[SOLIDS]), int(world[FIELD])
    while i < stop:
        if world[i] > x_max or world[i + 2] < x_min or world[i + 1] > y_max or world[i + 3] < y_min:
            i += int(world[i + 4])
            continue
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            ax, ay, bx, by = in_body(world, i, x, y, c, s)
            near = margin + world[i + 4]
            i += SIZE
            time = _advance_segment(world, ax, ay, bx, by, near, vx, vy, turn, bend, speed + spin, time)
            if time <= 0.0:
                return 0.0
    return time


@kernel
def _sweep(world: World, x: float, y: float, theta: float, p: float, q: float, w: float, arc: bool) -> bool:
    """Whether the motion over unit time from a pose keeps clear, given that both its ends do. Its velocity is
    (p, q) in the own frame and theta gains w, or else, when arc, (p, q, w) is a twist of the body."""
    turn = w if math.isnan(world[HEADING]) else 0.0
    bend = w if arc else 0.0
    speed = math.sqrt(p * p + q * q)
    top = speed + abs(turn) * world[REACH]
    margin = world[RADIUS] + world[MIN_CLEARANCE]
    size = math.sqrt(world[HALF_X] ** 2 + world[HALF_Y] ** 2) + margin
    u, span = 0.0, size
    for _ in range(_MAX_STEPS):
        heading = theta + w * u
        phi = footprint_heading(world, heading)
        c, s = math.cos(phi), math.sin(phi)
        if arc:
            half = 0.5 * w * u
            sinc = math.sin(half) / half if abs(half) > 1e-9 else 1.0
            ch, sh = math.cos(theta + half) * sinc * u, math.sin(theta + half) * sinc * u
            px, py = x + ch * p - sh * q, y + sh * p + ch * q
            ch, sh = math.cos(heading), math.sin(heading)
            vx, vy = ch * p - sh * q, sh * p + ch * q
        else:
            px, py, vx, vy = x + p * u, y + q * u, p, q
        time = 1.0 - u
        for k in range(int(world[DISCS]), int(world[WALLS]), 4):
            dx, dy = world[k], world[k + 1]
            room = field_bounds(world, px + c * dx - s * dy, py + s * dx + c * dy)[0]
            room -= world[k + 2] + margin + CONTACT
            pace = speed + abs(turn) * world[k + 3]
            if not room > 0.0:
                time = 0.0
            elif pace > 0.0:
                time = min(time, room / pace)
        if not time >= min(1.0 - u, 0.25 * size / top):
            ahead = min(1.0 - u, span / top)
            fine = _advance(world, px, py, c, s, c * vx + s * vy, c * vy - s * vx, turn, bend, ahead)
            if fine <= 0.0:
                return False
            time = max(time, fine)
            span = 2.0 * span if fine >= ahead else size
        if not u + time > u:
            return u >= 1.0
        u += time
        if u >= 1.0:
            return True
    return False


@kernel
def linear_free(world: World, ax: float, ay: float, ath: float, bx: float, by: float, bth: float) -> bool:
    """Whether every pose from a to b, interpolated in x, y and theta as given (not wrapped), is free."""
    x, y, theta = to_local(world, ax, ay, ath)
    ex, ey, end = to_local(world, bx, by, bth)
    distance = world[RADIUS] + world[MIN_CLEARANCE] + CONTACT
    if not clear(world, ex, ey, footprint_heading(world, end), distance):
        return False
    if not clear(world, x, y, footprint_heading(world, theta), distance):
        return False
    return _sweep(world, x, y, theta, ex - x, ey - y, bth - ath, False)


@kernel
def twist_free(world: World, x: float, y: float, theta: float, vx: float, vy: float, omega: float) -> bool:
    """Whether every pose is free while a twist (m/s, rad/s, body frame of theta) is held for 1 s."""
    px, py, heading = to_local(world, x, y, theta)
    half = 0.5 * omega
    sinc = math.sin(half) / half if abs(half) > 1e-9 else 1.0
    c, s = math.cos(heading + half) * sinc, math.sin(heading + half) * sinc
    ex, ey, end = px + c * vx - s * vy, py + s * vx + c * vy, heading + omega
    distance = world[RADIUS] + world[MIN_CLEARANCE] + CONTACT
    if not clear(world, ex, ey, footprint_heading(world, end), distance):
        return False
    if not clear(world, px, py, footprint_heading(world, heading), distance):
        return False
    return _sweep(world, px, py, heading, vx, vy, omega, True)


@kernel
def polyline_free(world: World, poses: Array) -> int:
    """The first i for which linear_free from poses[i] to poses[i + 1] is false, or -1. poses (n, 3)."""
    for i in range(len(poses) - 1):
        a, b = poses[i], poses[i + 1]
        if not linear_free(world, a[0], a[1], a[2], b[0], b[1], b[2]):
            return i
    return -1
