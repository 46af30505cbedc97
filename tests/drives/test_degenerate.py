"""Drives that cannot be built, and the sentence that says why."""

from __future__ import annotations

import math

import pytest

from drives import (
    DRIVES,
    Ackermann,
    Differential,
    Mecanum,
    Module,
    Omni,
    PoweredCaster,
    SkidSteer,
    Swedish,
    SwedishWheel,
    Swerve,
    Synchro,
    Tracked,
    Tricycle,
)
from drives.drive import InvalidDrive

TWO = (Module("a", 0.3, 0.0), Module("b", -0.3, 0.0))
LENGTHS = {
    Differential: ("wheel_radius", "track_width"),
    Tracked: ("wheel_radius", "track_width"),
    SkidSteer: ("wheel_radius", "track_width", "wheelbase"),
    Omni: ("wheel_radius", "robot_radius"),
    Mecanum: ("wheel_radius", "track_width", "wheelbase"),
    Tricycle: ("wheel_radius", "wheelbase", "track_width"),
    Ackermann: ("wheel_radius", "wheelbase", "track_width"),
    Synchro: ("wheel_radius",),
    Swerve: ("wheel_radius",),
    PoweredCaster: ("wheel_radius", "caster_offset"),
}


@pytest.mark.parametrize("bad", [0.0, -0.1, math.nan, math.inf, 1e-9, 1e9])
@pytest.mark.parametrize(
    ("drive", "name"),
    [(d, n) for d, ns in LENGTHS.items() for n in ns],
    ids=lambda v: getattr(v, "__name__", v),
)
def test_a_length_that_is_not_positive_and_sane_is_refused_by_name_value_and_bound(drive, name, bad) -> None:
    parameters = dict.fromkeys(LENGTHS[drive], 0.1) | {name: bad}
    if drive in (Swerve, PoweredCaster):
        parameters["modules"] = TWO
    with pytest.raises(InvalidDrive) as refusal:
        drive(**parameters)
    assert refusal.value.parameter == name
    assert all(part in str(refusal.value) for part in (name, repr(bad), "1e-06"))


def test_every_drive_with_a_length_has_its_lengths_checked_here() -> None:
    assert {*LENGTHS, Swedish} == set(DRIVES.values())


def ring(n: int, **changed) -> tuple[SwedishWheel, ...]:
    """n tangential wheels round a circle, the first of them changed."""
    wheels = []
    for i in range(n):
        a = 2 * math.pi * i / n
        wheel = {"name": f"w{i}", "x": math.cos(a), "y": math.sin(a), "heading": a + math.pi / 2}
        wheels.append(
            SwedishWheel(**(wheel | {"roller_angle": 0.0, "radius": 0.1} | (changed if i == 0 else {})))
        )
    return tuple(wheels)


@pytest.mark.parametrize(
    ("build", "parameter", "says"),
    [
        (lambda: Tracked(0.1, 0.5, 0.99), "slip_coefficient", "0.99"),
        (lambda: SkidSteer(0.1, 0.5, 0.4, 0.0), "slip_coefficient", "between 1 "),
        (lambda: SkidSteer(0.1, 0.5, 0.4, math.inf), "slip_coefficient", "inf"),
        (lambda: Omni(0.1, 0.2, 2), "wheel_count", "between 3 "),
        (lambda: Omni(0.1, 0.2, 10**9), "wheel_count", "64"),
        (lambda: Omni(0.1, 0.2, 3, math.nan), "wheel_offset", "nan"),
        (lambda: Synchro(0.1, 0), "wheel_count", "between 1 "),
        (lambda: Synchro(0.1, 3, math.inf), "body_heading", "inf"),
        (lambda: Swerve(0.1, TWO[:1]), "modules", "between 2 "),
        (lambda: Swerve(0.1, ()), "modules", "0"),
        (lambda: Swerve(0.1, (TWO[0], TWO[0])), "modules", "'a'"),
        (lambda: Swerve(0.1, (Module("", 0, 0), TWO[0])), "modules", "name"),
        (lambda: Swerve(0.1, (Module("a", 1, 1), Module("b", 1, 1))), "modules", "1e-06"),
        (lambda: Swerve(0.1, (Module("a", math.nan, 1), TWO[1])), "modules: x of 'a'", "nan"),
        (lambda: PoweredCaster(0.1, 0.04, (Module("a", 1, 1), Module("b", 1, 1))), "modules", "1e-06"),
        (lambda: Swedish(ring(3)[:2]), "wheels", "between 3 "),
        (lambda: Swedish((*ring(3), ring(3)[0])), "wheels", "'w0'"),
        (lambda: Swedish(ring(3, radius=0.0)), "wheels: radius of 'w0'", "0.0"),
        (lambda: Swedish(ring(3, roller_angle=math.pi / 2)), "wheels", "roller_angle of 'w0'"),
        (lambda: Swedish(ring(3, roller_angle=-math.pi / 2 + 1e-4)), "wheels", "cosine"),
        (lambda: Swedish(ring(3, heading=math.inf)), "wheels: heading of 'w0'", "inf"),
    ],
)
def test_a_degenerate_drive_is_refused_with_the_parameter_at_fault(build, parameter, says) -> None:
    with pytest.raises(InvalidDrive) as refusal:
        build()
    assert refusal.value.parameter == parameter
    assert says in str(refusal.value)


def swedish(*places: tuple[float, float, float], shift: tuple[float, float] = (0.0, 0.0)) -> Swedish:
    return Swedish(
        tuple(
            SwedishWheel(f"w{i}", x + shift[0], y + shift[1], h, 0.0, 0.1)
            for i, (x, y, h) in enumerate(places)
        )
    )


@pytest.mark.parametrize(
    "places",
    [
        [(1, 0, 0), (-1, 0, 0), (0, 1, 0)],
        [(1, 0, 0), (-1, 0, math.pi), (0, 1, math.pi / 2), (0, 3, math.pi / 2)],
        [(0, 0, 0), (0, 0, 1), (0, 0, 2)],
        [(1, 0, math.pi / 2), (1.00001, 0, math.pi / 2), (0, 1, 0)],
    ],
    ids=["none sideways", "all aimed at the origin", "all in one place", "two all but the same"],
)
@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -2.0)], ids=["here", "elsewhere"])
def test_swedish_wheels_that_do_not_reach_every_twist_are_refused_in_any_frame(places, shift) -> None:
    with pytest.raises(InvalidDrive, match="do not reach every twist"):
        swedish(*places, shift=shift)


@pytest.mark.parametrize("size", [1e-3, 1.0, 5.0])
def test_a_sound_swedish_drive_is_accepted_at_any_size_and_place(size) -> None:
    places = [(size * math.cos(a), size * math.sin(a), a + math.pi / 2) for a in (0.0, 2.1, 4.2)]
    swedish(*places)
    swedish(*places, shift=(1e5 * size, -1e5 * size))


def test_drives_are_values() -> None:
    assert Omni(0.1, 0.2) == Omni(0.1, 0.2, 3, 0.0)
    assert hash(Swerve(0.1, TWO)) == hash(Swerve(0.1, TWO))
    with pytest.raises(AttributeError):
        Omni(0.1, 0.2).wheel_radius = 1.0  # type: ignore[misc]
