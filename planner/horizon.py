"""Receding horizon: a long motion is optimized window by window, at a cost linear in its length.

Every window begins in the state that the last one was left in and ends at rest on the free way that the
whole began with. Only its first part is kept; its tail proves that the robot can still stop. Where the next
window cannot be solved, nor one half as long, the robot does stop: the whole of the last window is kept, and
the next begins at rest.

Source: Mayne et al. (2000), Constrained model predictive control: stability and optimality, Automatica 36.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from drives.drive import Drive
from drives.se2 import Array, Pose
from planner.guess import Guess, ramp_time
from planner.problem import Robot
from planner.trajectory import Flowing, Phases

__all__ = ["WINDOW", "State", "receding"]

WINDOW = 64
"""Knots of a window."""
_MOST, _LEAST = 48, 16
"""How many of them are kept."""
_SHORTEST = 32
"""Knots of the guess that a window is given at least, unless the goal is nearer."""
_STRETCH = 1.25
"""By how much the last window may be longer than others."""
_TAIL = 2.0
"""Time (s) that is not kept at least."""
_LEVER = 0.5
"""m that count as much as 1 rad where poses are compared."""
_NONE = np.zeros(0)


class State(NamedTuple):
    """Where a motion begins: pose, coordinates (c,) and their rates (c,), see Flowing. given: see Shape.
    angles (k,): of casters."""

    pose: Pose
    coordinates: Array
    rates: Array
    given: Literal["all", "curvature", "rest"]
    angles: Array = _NONE


def receding(
    guess: Guess, begin: State, robot: Robot, window: Callable[[Guess, State], Flowing | None]
) -> list[Flowing] | None:
    """Motions, one after the other, each from rest to rest and mostly only one; None where there is no
    going on.

    guess: of the whole, at poses that are free. window: the fastest free motion near a guess from a state to
    rest where the guess ends, or None.
    """
    runs: list[Flowing] = []
    kept: list[Flowing] = []
    last: Flowing | None = None
    n, at, end, keep = len(guess.time) - 1, 0, 0, 0
    reach, tail = WINDOW, max(_TAIL, 2 * ramp_time(robot.limits))
    while True:
        stop = n if n - at <= _STRETCH * reach else at + reach
        found = window(guess.part(at, stop, WINDOW), begin)
        if found is None:
            if reach > _SHORTEST:
                reach //= 2
                continue
            if last is None:
                return None
            runs.append(_joined([*kept, last]))
            begin, at = _stopped(last, robot.drive), end
            kept, last, reach = [], None, WINDOW
            continue
        if last is not None:
            kept.append(_cut(last, keep))
        last, end, reach = found, stop, WINDOW
        if end == n:
            return [*runs, _joined([*kept, last])]
        rest = last.duration - tail
        keep = min(max(int(np.searchsorted(last.time, rest)), _LEAST), _MOST)
        begin = _moving(last, keep, robot.drive)
        # Some progress along the guess at least, even where it comes back to where it was.
        later = np.arange(at + (end - at) // 4, end)
        away = (guess.pose[later] - begin.pose) * np.array([1.0, 1.0, _LEVER])
        at = int(later[np.argmin((away**2).sum(1))])


def _moving(motion: Flowing, knot: int, drive: Drive) -> State:
    """The state at a knot."""
    pose, angles = Pose(*motion.poses(motion.time)[knot].tolist()), _angles(motion, knot, drive)
    return State(pose, motion.coefficients[knot, 0], motion.coefficients[knot, 1], "all", angles)


def _angles(motion: Flowing, knot: int, drive: Drive) -> Array:
    """Those of casters at a knot."""
    if motion.steering is None:
        return _NONE
    angles: Array = Phases(drive, (motion,)).sample(motion.time[[knot]]).steering_angle[0]
    return angles


def _stopped(motion: Flowing, drive: Drive) -> State:
    """The state at the end: wheels stay steered as they are."""
    pose = Pose(*motion.poses(motion.time)[-1].tolist())
    coordinates = np.zeros(motion.coefficients.shape[2])
    if motion.curves:
        step = motion.time[-1] - motion.time[-2]
        coordinates[1] = motion.coefficients[-1, :, 1] @ step ** np.arange(3.0)
    given: Literal["all", "curvature"] = "curvature" if motion.curves else "all"
    return State(pose, coordinates, np.zeros_like(coordinates), given, _angles(motion, -1, drive))


def _cut(motion: Flowing, knot: int) -> Flowing:
    """The motion up to a knot."""
    return replace(motion, time=motion.time[: knot + 1], coefficients=motion.coefficients[:knot])


def _joined(parts: list[Flowing]) -> Flowing:
    """One motion of parts that follow one another."""
    begins = np.cumsum([0.0, *(part.duration for part in parts)])
    times = [begin + part.time[:-1] for begin, part in zip(begins, parts, strict=False)]
    return replace(
        parts[0],
        time=np.append(np.concatenate(times), math.fsum(part.duration for part in parts)),
        coefficients=np.concatenate([part.coefficients for part in parts]),
    )
