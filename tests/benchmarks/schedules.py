"""The known motion of a case as the answer of a planner that stops after every piece."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.fuzz.kinematics import steered_names, wheels
from benchmarks.fuzz.motion import Motion, Piece, aimed_at, bounds, ramps, steering_time
from benchmarks.fuzz.request import Case


def answer_of(case: Case) -> dict[str, Any]:
    """The plan document of the known motion. Not for powered casters, whose angles follow the motion."""
    request, period = case.request, case.request["options"]["sample_period"]
    drive, limits = request["robot"]["drive"], request["robot"]["limits"]
    k = len(steered_names(drive))
    given = request["start"].get("steering")
    steering = np.array(list(given.values())) if given else None
    if drive["type"] == "synchro" and steering is None:
        steering = np.full(k, request["start"]["theta"] - _heading(request))
    wheel = [np.zeros((1, len(wheels(drive))))]
    rate = [np.zeros_like(wheel[0])]
    angle, swing, pose, twist = [], [np.zeros((1, k))], [case.motion.start[None]], [np.zeros((1, 3))]
    for piece in case.motion.pieces:
        synchro = drive["type"] == "synchro"
        aimed = aimed_at(drive, limits, piece, steering)
        if not angle:
            angle.append((aimed if steering is None else steering).reshape(1, k))
        if not synchro and k and steering is not None and np.abs(aimed - steering).max() > 1e-12:
            way, speed = _steer(float(np.abs(aimed - steering).max()), limits["steering_rate"], period)
            share = way[:, None] / way[-1]
            still = np.zeros((len(way), 1))
            wheel.append(wheel[-1][-1] + still * wheel[0])
            rate.append(still * wheel[0])
            angle.append(steering + share * (aimed - steering))
            swing.append(speed[:, None] / way[-1] * (aimed - steering))
            pose.append(pose[-1][-1] + still * np.zeros(3))
            twist.append(still * np.zeros(3))
        s, ds = _profile(*ramps(*bounds(drive, limits, piece, aimed), period), period)
        per = _wheel_rates(drive, piece, aimed)
        wheel.append(wheel[-1][-1] + s[:, None] * per)
        rate.append(ds[:, None] * per)
        turn = piece.omega if synchro else 0.0
        angle.append(angle[-1][-1] + s[:, None] * turn if synchro else np.tile(aimed, (len(s), 1)))
        swing.append(np.tile(ds[:, None] * turn, (1, k)))
        pose.append(_along(Motion(pose[-1][-1], (piece,)), s))
        twist.append(ds[:, None] * np.array([piece.vx, piece.vy, piece.omega]))
        steering = angle[-1][-1]
    columns = [np.concatenate(each) for each in (wheel, rate, angle, swing, pose, twist)]
    time = np.arange(len(columns[0])) * period
    return _document(drive, time, *columns)


def _heading(request: dict[str, Any]) -> float:
    return float(request["robot"]["drive"].get("body_heading", request["start"]["theta"]))


def _profile(a: float, b: float, c: float, period: float) -> tuple[Any, Any]:
    """s and its rate at the samples after the first: boxes of whole periods, one after the other."""
    na, nb, nc = (round(each / period) for each in (a, b, c))
    change = np.zeros(na + nb + nc)  # with limited jerk, the last is a period at rest
    push = np.convolve(np.ones(nb), np.ones(max(nc, 1)) / max(nc, 1)) / (a * b)
    change[: len(push)] += push
    change[na : na + len(push)] -= push
    speed = np.cumsum(change) * period
    before = np.concatenate([[0.0], speed[:-1]])
    speed[na + nb + max(nc, 1) - 2 :] = 0.0
    return np.cumsum((before + speed) / 2) * period, speed


def _steer(turn: float, most: float, period: float) -> tuple[Any, Any]:
    """The turn and its rate at the samples after the first: a period to rise, one to fall."""
    n = round(steering_time(turn, most, period) / period)
    speed = np.full(n, turn / ((n - 1) * period))
    speed[-1] = 0.0
    before = np.concatenate([[0.0], speed[:-1]])
    return np.cumsum((before + speed) / 2) * period, speed


def _wheel_rates(drive: dict[str, Any], piece: Piece, steering: Any) -> Any:
    rates, steered = [], 0
    for wheel in wheels(drive):
        direction = wheel.heading + (wheel.roller or 0.0)
        px, py = piece.vx - wheel.y * piece.omega, piece.vy + wheel.x * piece.omega
        if wheel.steers and drive["type"] != "synchro":
            direction, steered = float(steering[steered]), steered + 1
        along = px * math.cos(direction) + py * math.sin(direction)
        rates.append(along / (wheel.radius * math.cos(wheel.roller or 0.0)))
    return np.array(rates)


def _along(motion: Motion, s: Any) -> Any:
    piece = motion.pieces[0]
    found = []
    for share in s:
        part = Piece(piece.vx * share, piece.vy * share, piece.omega * share)
        found.append(Motion(motion.start, (part,)).goal)
    return np.array(found)


def _document(drive: dict[str, Any], time: Any, wheel: Any, rate: Any, angle: Any, swing: Any, pose: Any,
              twist: Any) -> dict[str, Any]:  # fmt: skip
    names = [each.name for each in wheels(drive)]
    keys = ("x", "y", "theta", "vx", "vy", "omega")
    return {
        "duration": float(time[-1]),
        "schedule": {
            "time": time,
            "wheels": {name: {"angle": wheel[:, i], "velocity": rate[:, i]} for i, name in enumerate(names)},
            "steering": {
                name: {"angle": angle[:, i], "rate": swing[:, i]}
                for i, name in enumerate(steered_names(drive))
            },
        },
        "trajectory": dict(zip(keys, np.hstack([pose, twist]).T, strict=True)),
        "certificate": {"clearance": -1.0},
    }
