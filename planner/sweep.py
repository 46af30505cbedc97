"""Footprint against world along whole edges, compiled.

Edges are checked by conservative advancement (Mirtich, 1996): two convex pieces that lie d apart along n cannot
meet before an end point of the moving one has moved d along n. So sliding along a wall, however close, takes
no more steps than open space does, and nothing is skipped between them.

A valid edge is valid everywhere on it, ends included. An edge not decided in 100,000 steps counts as a hit.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.collision import CONTACT, World, clear, field_bounds, footprint_heading, to_local
from planner.tree import Tree, closest, kernel

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
    edges: Tree, ax: float, ay: float, bx: float, by: float, near: float,
    vx: float, vy: float, turn: float, bend: float, top: float, time: float,
) -> float:  # fmt: skip
    """_advance against the one segment ab, in the body frame, for contact at a distance `near`."""
    x_min, x_max, y_min, y_max = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    i = 0
    while i < len(edges.boxes):
        far = near + max(top * time, CONTACT)
        dx = max(edges.boxes[i, 0] - x_max, 0.0, x_min - edges.boxes[i, 2])
        dy = max(edges.boxes[i, 1] - y_max, 0.0, y_min - edges.boxes[i, 3])
        if dx * dx + dy * dy > far * far:
            i = edges.links[i, 0]
            continue
        first = edges.links[i, 1]
        for k in range(first, first + edges.links[i, 2]):
            e = edges.segments[k]
            square, px, py, qx, qy = closest(e[0], e[1], e[2], e[3], ax, ay, bx, by)
            d = math.sqrt(square)
            if not d - near > CONTACT:
                return 0.0
            if d - near >= top * time:
                continue
            nx, ny = (qx - px) / d, (qy - py) / d
            for v in range(0, 4, 2):
                ux, uy = vx - turn * e[v + 1], vy + turn * e[v]
                # Along the edge, displacement is affine in the point: its two ends bound all of it.
                gap = d - near + max(0.0, nx * (px - e[v]) + ny * (py - e[v + 1]))
                pull = turn * turn * math.sqrt(e[v] ** 2 + e[v + 1] ** 2)
                if bend != 0.0:
                    pull = abs(bend) * math.sqrt(ux * ux + uy * uy)
                time = min(time, _first_contact(gap, nx * ux + ny * uy, pull))
        i += 1
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
    body, tree = world.body, world.tree
    margin = body.radius + world.min_clearance
    speed = math.sqrt(vx * vx + vy * vy)
    top = speed + abs(turn) * body.reach
    loose = margin + CONTACT + abs(turn) * body.reach * time + 0.5 * abs(bend) * speed * time * time
    mx, my = x + c * body.x - s * body.y, y + s * body.x + c * body.y
    ex = abs(c) * body.half_x + abs(s) * body.half_y + loose
    ey = abs(s) * body.half_x + abs(c) * body.half_y + loose
    wx, wy = (c * vx - s * vy) * time, (s * vx + c * vy) * time
    x_min, x_max = mx - ex + min(wx, 0.0), mx + ex + max(wx, 0.0)
    y_min, y_max = my - ey + min(wy, 0.0), my + ey + max(wy, 0.0)
    i = 0
    while i < len(tree.boxes):
        if (
            tree.boxes[i, 0] > x_max
            or tree.boxes[i, 2] < x_min
            or tree.boxes[i, 1] > y_max
            or tree.boxes[i, 3] < y_min
        ):
            i = tree.links[i, 0]
            continue
        first = tree.links[i, 1]
        for k in range(first, first + tree.links[i, 2]):
            dx, dy = tree.segments[k, 0] - x, tree.segments[k, 1] - y
            ax, ay = c * dx + s * dy, c * dy - s * dx
            dx, dy = tree.segments[k, 2] - x, tree.segments[k, 3] - y
            bx, by = c * dx + s * dy, c * dy - s * dx
            near = margin + tree.segments[k, 4]
            time = _advance_segment(body.edges, ax, ay, bx, by, near, vx, vy, turn, bend, top, time)
            if time <= 0.0:
                return 0.0
        i += 1
    return time


@kernel
def _sweep(world: World, x: float, y: float, theta: float, p: float, q: float, w: float, arc: bool) -> bool:
    """Whether the motion over unit time from a pose keeps clear, where both its ends are known to. Its velocity
    is (p, q) in the own frame and theta gains w, or else, when arc, (p, q, w) is a twist of the body."""
    body = world.body
    turn = w if math.isnan(body.heading) else 0.0
    bend = w if arc else 0.0
    speed = math.sqrt(p * p + q * q)
    top = speed + abs(turn) * body.reach
    size = math.sqrt(body.half_x**2 + body.half_y**2) + body.radius + world.min_clearance
    margin = body.radius + world.min_clearance + CONTACT
    u, px, py = 0.0, x, y
    for _ in range(_MAX_STEPS):
        heading = theta + w * u
        phi = footprint_heading(world, heading)
        c, s = math.cos(phi), math.sin(phi)
        vx, vy = p, q
        if arc:
            half = 0.5 * w * u
            sinc = math.sin(half) / half if abs(half) > 1e-9 else 1.0
            ch, sh = math.cos(theta + half) * sinc * u, math.sin(theta + half) * sinc * u
            px, py = x + ch * p - sh * q, y + sh * p + ch * q
            ch, sh = math.cos(heading), math.sin(heading)
            vx, vy = ch * p - sh * q, sh * p + ch * q
        else:
            px, py = x + p * u, y + q * u
        time = 1.0 - u
        for k in range(len(body.discs)):
            dx, dy = body.discs[k, 0], body.discs[k, 1]
            room = (
                field_bounds(world, px + c * dx - s * dy, py + s * dx + c * dy)[0] - body.discs[k, 2] - margin
            )
            pace = speed + abs(turn) * body.discs[k, 3]
            time = min(time, room / pace) if pace > 0.0 else time
        if not time >= min(1.0 - u, 0.25 * size / top):
            time = max(time, 0.0)
            ahead = min(1.0 - u, max(size, world.step) / top)
            fine = _advance(world, px, py, c, s, c * vx + s * vy, c * vy - s * vx, turn, bend, ahead)
            if fine <= 0.0:
                return False
            time = max(time, fine)
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
    distance = world.body.radius + world.min_clearance + CONTACT
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
    distance = world.body.radius + world.min_clearance + CONTACT
    if not clear(
        world, px + c * vx - s * vy, py + s * vx + c * vy, footprint_heading(world, heading + omega), distance
    ):
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
