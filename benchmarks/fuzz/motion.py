"""A motion that a robot can make, known beforehand, and how long it takes at most from stop to stop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.fuzz.kinematics import HOLONOMIC, Array, Wheel, steered_names, wheels
from benchmarks.fuzz.robot import log_uniform, reach, smallest_radius

__all__ = ["Motion", "Piece", "aimed_at", "bounds", "draw_motion", "ramps", "steering_time"]

_STEPS = 4000
"""Places along a piece at which a caster's swing is looked at."""


@dataclass(frozen=True)
class Piece:
    """A constant body twist for one unit of time: (vx m, vy m, omega rad)."""

    vx: float
    vy: float
    omega: float


@dataclass(frozen=True)
class Motion:
    """Pieces from a start pose (3,), with a stop after each."""

    start: Array
    pieces: tuple[Piece, ...]

    @property
    def goal(self) -> Array:
        """The pose (3,) at its end, heading unwrapped."""
        end: Array = self.poses(lambda _: 1)[-1]
        return end

    def poses(self, steps: Callable[[Piece], int]) -> Array:
        """Poses (n, 3) along it: steps(piece) of equal length along each piece."""
        found, at = [self.start[None]], self.start
        for piece in self.pieces:
            share = np.linspace(0.0, 1.0, max(1, steps(piece)) + 1)[1:]
            turn = piece.omega * share
            # ∫ of the rotation by turn: sin(turn)/omega and (1 - cos(turn))/omega, by series when small
            sine = share * np.sinc(turn / math.pi)
            rest = share * np.sin(turn / 2) * np.sinc(turn / math.tau)
            dx, dy = piece.vx * sine - piece.vy * rest, piece.vx * rest + piece.vy * sine
            c, s = math.cos(at[2]), math.sin(at[2])
            along = np.stack([at[0] + c * dx - s * dy, at[1] + s * dx + c * dy, at[2] + turn], 1)
            found.append(along)
            at = along[-1]
        return np.concatenate(found)

    def duration(self, request: dict[str, Any]) -> float:
        """An upper bound (s) on the shortest stop-to-stop motion along it, on the grid of the client."""
        drive, period = request["robot"]["drive"], request["options"].get("sample_period", 0.02)
        limits = request["robot"]["limits"]
        now: Array | None = None
        names = steered_names(drive)
        if "steering" in request["start"]:
            now = np.array([request["start"]["steering"][name] for name in names])
        elif drive["type"] == "powered_caster":
            now = np.zeros(len(names))
        total = 0.0
        for piece in self.pieces:
            if drive["type"] == "powered_caster":
                assert now is not None
                lasting, now = _by_casters(drive, limits, piece, now, period)
            else:
                aimed = aimed_at(drive, limits, piece, now)
                if now is not None and len(aimed):
                    total += steering_time(float(np.abs(aimed - now).max()), limits["steering_rate"], period)
                now = aimed
                lasting = sum(ramps(*bounds(drive, limits, piece, aimed), period))
            total += lasting
        return total


def draw_motion(
    rng: np.random.Generator, robot: dict[str, Any], options: dict[str, Any], start: Array, length: float
) -> Motion:
    """A random motion about `length` m long that the drive can make under the options."""
    kind = robot["drive"]["type"]
    count = int(rng.choice([1, 1, 2, 3, 4]))
    draw = _holonomic if kind in HOLONOMIC else _nonholonomic
    pieces = tuple(draw(rng, robot, options, length / count) for _ in range(count))
    return Motion(start, pieces)


def _holonomic(rng: np.random.Generator, _: dict[str, Any], options: dict[str, Any], length: float) -> Piece:
    shape = rng.choice(["screw", "screw", "line", "turn"])
    turn = rng.uniform(-1.8, 1.8)
    if shape == "turn":
        return Piece(0.0, 0.0, turn)
    # The planner moves a holonomic robot that must not reverse along its heading only.
    way = rng.uniform(-math.pi, math.pi) if options.get("reverse", True) else 0.0
    return Piece(length * math.cos(way), length * math.sin(way), 0.0 if shape == "line" else turn)


def _nonholonomic(
    rng: np.random.Generator, robot: dict[str, Any], options: dict[str, Any], length: float
) -> Piece:
    least = max(smallest_radius(robot), options.get("turning_radius", 0.0))
    sense = -1.0 if options.get("reverse", True) and rng.random() < 0.4 else 1.0
    shape = rng.choice(["arc", "arc", "line", "turn"])
    if shape == "turn" and least == 0.0:
        return Piece(0.0, 0.0, rng.uniform(-2.5, 2.5))
    if shape == "line":
        return Piece(sense * length, 0.0, 0.0)
    radius = (
        least * log_uniform(rng, 1.02, 4.0)
        if least
        else reach(robot["footprint"]) * log_uniform(rng, 0.2, 5.0)
    )
    length = min(length, 4.0 * radius)
    return Piece(sense * length, 0.0, float(rng.choice([-1, 1])) * length / radius)


def _axis(wheel: Wheel, piece: Piece) -> tuple[float, float]:
    return piece.vx - wheel.y * piece.omega, piece.vy + wheel.x * piece.omega


def aimed_at(drive: dict[str, Any], limits: dict[str, Any], piece: Piece, now: Array | None) -> Array:
    """Steering angles (k,) rad along a piece, of the possible ones those nearest to the present ones."""
    if drive["type"] == "synchro":  # angles turn with theta; none has to be aimed
        return np.zeros(0)
    found: list[float] = []
    for wheel in wheels(drive):
        if not wheel.steers:
            continue
        px, py = _axis(wheel, piece)
        hold = None if now is None else float(now[len(found)])
        if math.hypot(px, py) < 1e-12 * (abs(piece.vx) + abs(piece.vy) + abs(piece.omega)):
            found.append(hold or 0.0)
            continue
        angle = math.atan2(py, px)
        most = limits.get("steering_angle", 1e3)
        near = 0.0 if hold is None else hold
        allowed = [angle + k * math.pi for k in range(-3, 4) if abs(angle + k * math.pi) <= most + 1e-9]
        found.append(min(allowed, key=lambda a: abs(a - near), default=angle))
    return np.array(found)


def _limit(value: Any, name: str) -> float:
    return float(value[name] if isinstance(value, dict) else value)


def bounds(
    drive: dict[str, Any], limits: dict[str, Any], piece: Piece, steering: Array
) -> tuple[float, float, float]:
    """The most that speed, acceleration and jerk along a piece (1/s, 1/s², 1/s³) may be."""
    rates, steered = {}, 0
    for wheel in wheels(drive):
        px, py = (piece.vx, piece.vy) if drive["type"] == "synchro" else _axis(wheel, piece)
        direction = wheel.heading + (wheel.roller or 0.0)
        if wheel.steers and drive["type"] != "synchro":
            direction, steered = float(steering[steered]), steered + 1
        along = px * math.cos(direction) + py * math.sin(direction)
        rates[wheel.name] = abs(along) / (wheel.radius * math.cos(wheel.roller or 0.0))
    speed, acceleration, jerk = _body_bounds(limits, piece)
    if drive["type"] == "synchro" and piece.omega:
        speed = min(speed, limits["steering_rate"] / abs(piece.omega))
    for name, rate in rates.items():
        if rate > 0:
            speed = min(speed, _limit(limits["wheel_speed"], name) / rate)
            acceleration = min(acceleration, _limit(limits["wheel_acceleration"], name) / rate)
            if "wheel_jerk" in limits:
                jerk = min(jerk, _limit(limits["wheel_jerk"], name) / rate)
    return speed, acceleration, jerk


def _body_bounds(limits: dict[str, Any], piece: Piece) -> tuple[float, float, float]:
    travel, turn = math.hypot(piece.vx, piece.vy), abs(piece.omega)
    speed = acceleration = math.inf
    if travel > 0:
        speed = limits.get("linear_speed", math.inf) / travel
        acceleration = limits.get("linear_acceleration", math.inf) / travel
    if turn > 0:
        speed = min(speed, limits.get("angular_speed", math.inf) / turn)
    if travel * turn > 0:
        speed = min(speed, math.sqrt(limits.get("lateral_acceleration", math.inf) / (travel * turn)))
    return speed, acceleration, math.inf


def ramps(speed: float, acceleration: float, jerk: float, period: float) -> tuple[float, float, float]:
    """How to go from 0 to 1 from rest to rest, changing acceleration on the grid only, in the shortest time.

    The velocity is a box of length a (s), smoothed by boxes of lengths b and c: its height is 1/a, its slope
    1/(a b), its second derivative 1/(a b c), if a >= b + c. All three are whole periods; their sum is the
    duration.
    """
    longest = 1 / speed + 2 / math.sqrt(acceleration) + (4 / jerk ** (1 / 3) if jerk < math.inf else 0.0)
    whole = np.unique(np.ceil(np.geomspace(1.0, max(longest / period, 1.0) + 1, 400))) * period
    b = whole[:, None]
    if jerk == math.inf:
        c = np.zeros((1, 1))
        a = np.maximum.reduce([1 / speed + 0 * b, 1 / (acceleration * b), b])
    else:
        c = whole[None]
        a = np.maximum.reduce(
            [1 / speed + 0 * b * c, 1 / (acceleration * b) + 0 * c, 1 / (jerk * b * c), b + c]
        )
    a = np.ceil(a / period * (1 - 1e-12)) * period
    total = a + b + c
    best = np.unravel_index(int(total.argmin()), total.shape)
    return float(a[best]), float((b + 0 * c)[best]), float((c + 0 * b)[best])


def steering_time(turn: float, rate: float, period: float) -> float:
    """The time (s) of a turn (rad) of the steering at rest, whose rate takes a period to rise and to fall."""
    return 0.0 if turn < 1e-12 else (math.ceil(turn / (rate * period)) + 1) * period


def _by_casters(
    drive: dict[str, Any], limits: dict[str, Any], piece: Piece, steering: Array, period: float
) -> tuple[float, Array]:
    """The time (s) along a piece, and the angles (k,) at its end. Bounds hold with the largest derivatives
    of the swing along the piece, so the time is an upper bound."""
    trail, r = drive["caster_offset"], drive["wheel_radius"]
    table = wheels(drive)
    p = np.array([_axis(wheel, piece) for wheel in table])
    share = np.linspace(0.0, 1.0, _STEPS + 1)
    angles = np.stack(
        [_swung(x, y, piece.omega, trail, at, share) for (x, y), at in zip(p, steering, strict=True)], 1
    )
    along = (np.cos(angles) * p[:, 0] + np.sin(angles) * p[:, 1]) / r
    first = np.gradient(along, share, axis=0)
    second = np.gradient(first, share, axis=0)
    turning = np.abs((np.cos(angles) * p[:, 1] - np.sin(angles) * p[:, 0]) / trail - piece.omega).max()
    speed, acceleration, jerk = _body_bounds(limits, piece)
    speed = min(speed, limits["steering_rate"] / max(turning, 1e-12))
    # A cubic over a period resolves the swing while the axis moves by half the trail at most.
    speed = min(speed, 0.5 * trail / (period * max(float(np.hypot(*p.T).max()), 1e-12)))
    for i, wheel in enumerate(table):
        most = [float(np.abs(column[:, i]).max()) + 1e-12 for column in (along, first, second)]
        top, push = (
            _limit(limits["wheel_speed"], wheel.name),
            _limit(limits["wheel_acceleration"], wheel.name),
        )
        speed = min(speed, top / most[0], math.sqrt(push / 2 / most[1]))
        acceleration = min(acceleration, push / 2 / most[0])
        if "wheel_jerk" in limits:
            snap = _limit(limits["wheel_jerk"], wheel.name)
            speed = min(speed, (snap / 4 / most[2]) ** (1 / 3))
            acceleration = min(acceleration, snap / 12 / (most[1] * speed))
            jerk = min(jerk, snap / 2 / most[0])
    return sum(ramps(speed, acceleration, jerk, period)), angles[-1]


def _swung(px: float, py: float, omega: float, trail: float, begin: float, share: Array) -> Array:
    """Angles (n,) rad of a caster led along at a constant twist, in closed form: z = exp(i angle) obeys
    z' = P/2b - iωz - P*/2b z² with P = px + i py, whose flow is a Möbius map."""
    lead = complex(px, py) / (2 * trail)
    root = np.sqrt(complex(abs(lead) ** 2 - omega**2 / 4))
    t = np.tanh(root * share) / root if abs(root) > 1e-12 else share.astype(complex)
    z = np.exp(1j * begin)
    moved = ((1 - t * 0.5j * omega) * z + t * lead) / (t * lead.conjugate() * z + 1 + t * 0.5j * omega)
    found: Array = np.unwrap(np.angle(moved))
    continued: Array = found - found[0] + begin
    return continued
