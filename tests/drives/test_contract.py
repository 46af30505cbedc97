"""What drives/drive.py promises, held against every drive of the registry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import (
    DRIVES,
    Ackermann,
    Differential,
    Drive,
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
from drives.drive import BodyPath, Car, Holonomic, InadmissibleTwist, Limits, Unicycle
from drives.se2 import Twist

SWEDISH = (
    SwedishWheel("a", 0.3, 0.0, 1.57, 0.0, 0.05),
    SwedishWheel("b", -0.2, 0.2, 0.1, math.pi / 4, 0.06),
    SwedishWheel("c", -0.2, -0.2, 0.0, -math.pi / 4, 0.07),
)
THREE = (Module("a", 0.3, 0.2), Module("b", -0.3, 0.2), Module("c", 0.0, -0.3))
EXAMPLES: dict[str, Drive] = {
    "differential": Differential(wheel_radius=0.1, track_width=0.5),
    "tracked": Tracked(wheel_radius=0.1, track_width=0.5, slip_coefficient=1.4),
    "skid_steer": SkidSteer(wheel_radius=0.1, track_width=0.5, wheelbase=0.4, slip_coefficient=1.6),
    "omni": Omni(wheel_radius=0.05, robot_radius=0.2, wheel_count=4, wheel_offset=0.3),
    "mecanum": Mecanum(wheel_radius=0.08, track_width=0.4, wheelbase=0.5),
    "swedish": Swedish(wheels=SWEDISH),
    "tricycle": Tricycle(wheel_radius=0.1, wheelbase=0.8, track_width=0.5),
    "ackermann": Ackermann(wheel_radius=0.1, wheelbase=0.8, track_width=0.5),
    "synchro": Synchro(wheel_radius=0.1, wheel_count=3, body_heading=0.4),
    "swerve": Swerve(wheel_radius=0.05, modules=THREE),
    "powered_caster": PoweredCaster(wheel_radius=0.05, caster_offset=0.04, modules=THREE),
}
KINDS = sorted(EXAMPLES)
LIMITS = Limits(np.ones(1), np.ones(1), np.ones(1), steering_angle=1.1)
every_drive = pytest.mark.parametrize("kind", KINDS)

speed = st.floats(-3.0, 3.0).map(lambda v: 0.0 if abs(v) < 1e-3 else v)
fast = settings(max_examples=60, deadline=None)


def admissible(drive: Drive, vx: float, vy: float, omega: float) -> Twist:
    """The nearest thing to (vx, vy, omega) that the drive can do."""
    return Twist(vx, vy if isinstance(drive.mobility(LIMITS), Holonomic) else 0.0, omega)


def smooth_path(drive: Drive, seed: int, n: int = 2001, length: float = 2.0) -> BodyPath:
    """A path with a smooth random tangent that the drive can do, forwards or backwards."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, length, n)
    sense, vx, vy, turn = rng.choice([-1.0, 1.0]), *rng.uniform(0.1, 0.3, 2), rng.uniform(0.3, 0.8)
    fx, fy, ft = rng.uniform(0.5, 2.0, 3)
    v, dv = 1 + vx * np.sin(fx * s), vx * fx * np.cos(fx * s)
    side, dside = vy * np.sin(fy * s + 1), vy * fy * np.cos(fy * s + 1)
    omega, domega = turn * np.sin(ft * s), turn * ft * np.cos(ft * s)
    heading = 0.3 + sense * turn / ft * (1 - np.cos(ft * s))
    if not isinstance(drive.mobility(LIMITS), Holonomic):
        side, dside = 0 * s, 0 * s
    tangent = sense * np.stack([v, side, omega], axis=1)
    return BodyPath(s, heading, tangent, sense * np.stack([dv, dside, domega], axis=1))


def central_difference(y: np.ndarray, h: float) -> np.ndarray:
    """dy/ds at all but the first and last three samples, to sixth order."""
    one, two, three = (y[3 + k : len(y) - 3 + k] - y[3 - k : len(y) - 3 - k] for k in (1, 2, 3))
    return (45 * one - 9 * two + three) / (60 * h)


def test_the_registry_holds_the_contracts_drives_in_its_order() -> None:
    assert list(DRIVES) == [
        "differential",
        "tracked",
        "skid_steer",
        "omni",
        "mecanum",
        "swedish",
        "tricycle",
        "ackermann",
        "synchro",
        "swerve",
        "powered_caster",
    ]
    for kind, drive in DRIVES.items():
        assert drive.kind == kind
        assert isinstance(EXAMPLES[kind], drive)


FOUR = ("front_left", "front_right", "rear_left", "rear_right")
NUMBERED = ("wheel_1", "wheel_2", "wheel_3")


@pytest.mark.parametrize(
    ("kind", "wheels", "steered"),
    [
        ("differential", ("left", "right"), ()),
        ("tracked", ("left", "right"), ()),
        ("skid_steer", FOUR, ()),
        ("omni", (*NUMBERED, "wheel_4"), ()),
        ("mecanum", FOUR, ()),
        ("swedish", ("a", "b", "c"), ()),
        ("tricycle", ("front", "rear_left", "rear_right"), ("front",)),
        ("ackermann", FOUR, FOUR[:2]),
        ("synchro", NUMBERED, NUMBERED),
        ("swerve", ("a", "b", "c"), ("a", "b", "c")),
        ("powered_caster", ("a", "b", "c"), ("a", "b", "c")),
    ],
)
def test_wheels_are_named_and_ordered_as_in_the_contract(kind, wheels, steered) -> None:
    assert (EXAMPLES[kind].wheel_names, EXAMPLES[kind].steered_names) == (wheels, steered)


@every_drive
def test_mobility_is_what_the_wheels_allow(kind) -> None:
    inner = 0.8 / math.tan(1.1)
    expected = {"tricycle": Car(inner), "ackermann": Car(inner + 0.25)} | dict.fromkeys(
        ("differential", "tracked", "skid_steer", "synchro"), Unicycle()
    )
    assert EXAMPLES[kind].mobility(LIMITS) == expected.get(kind, Holonomic())


@every_drive
def test_only_wheels_that_hold_their_angle_freely_steer_at_rest(kind) -> None:
    assert EXAMPLES[kind].steers_at_rest == (kind in ("tricycle", "ackermann", "swerve"))


@every_drive
def test_only_a_synchro_footprint_keeps_its_heading(kind) -> None:
    assert EXAMPLES[kind].fixed_body_heading == (0.4 if kind == "synchro" else None)


@every_drive
@fast
@given(vx=speed, vy=speed, omega=speed, seed=st.integers(0, 99))
def test_forward_undoes_inverse_without_slip(kind, vx, vy, omega, seed) -> None:
    drive = EXAMPLES[kind]
    twist = admissible(drive, vx, vy, omega)
    present = np.random.default_rng(seed).uniform(-3, 3, len(drive.steered_names))
    state = drive.inverse(twist, present)
    found, slip = drive.forward(state.rates[None], state.steering[None], state.steering_rates[None])
    np.testing.assert_allclose(found[0], twist, atol=1e-12, rtol=0)
    assert slip[0] < 1e-12


@every_drive
@fast
@given(vx=speed, vy=speed, omega=speed, scale=st.floats(1e-3, 1e3))
def test_rates_have_degree_one_and_steering_degree_zero_in_the_twist(kind, vx, vy, omega, scale) -> None:
    drive = EXAMPLES[kind]
    twist = admissible(drive, vx, vy, omega)
    one, many = drive.inverse(twist), drive.inverse(Twist(*(scale * v for v in twist)))
    size = scale * (1 + np.abs(one.rates).max())
    np.testing.assert_allclose(many.rates, scale * one.rates, atol=1e-12 * size, rtol=0)
    np.testing.assert_allclose(many.steering_rates, scale * one.steering_rates, atol=1e-12 * size, rtol=0)
    np.testing.assert_allclose(many.steering, one.steering, atol=1e-12, rtol=0)


@every_drive
@fast
@given(vx=speed, vy=speed, omega=speed)
def test_the_rolling_law_gives_the_rates_of_the_settled_drive_up_to_the_sense_of_steered_wheels(
    kind, vx, vy, omega
) -> None:
    drive = EXAMPLES[kind].settled
    law, twist = drive.rolling_law(), admissible(drive, vx, vy, omega)
    x, y = law.points.T
    pointed = np.hypot(twist.vx - y * twist.omega, twist.vy + x * twist.omega) / law.radius
    state = drive.inverse(twist)
    rolled = np.where(law.steered, np.abs(state.rates), state.rates)
    np.testing.assert_allclose(np.where(law.steered, pointed, law.rows @ twist), rolled, atol=1e-10, rtol=0)
    if len(drive.steered_names):
        assert law.heading_steers == (not law.steered.any())


@every_drive
@fast
@given(vx=speed, vy=st.floats(1e-3, 3.0), omega=speed)
def test_a_sideways_twist_is_refused_by_the_drives_that_cannot_do_it_and_by_no_other(
    kind, vx, vy, omega
) -> None:
    drive, twist = EXAMPLES[kind], Twist(vx, vy, omega)
    tangent = np.tile(np.array([twist]), (3, 1))
    path = BodyPath(np.arange(3.0), np.arange(3.0) * omega, tangent, 0 * tangent)
    if isinstance(drive.mobility(LIMITS), Holonomic):
        drive.inverse(twist)
        drive.actuators(path)
        return
    with pytest.raises(InadmissibleTwist, match="vy"):
        drive.inverse(twist)
    with pytest.raises(InadmissibleTwist, match="vy"):
        drive.actuators(path)


@every_drive
def test_a_twist_that_is_not_a_number_is_never_called_admissible_sideways(kind) -> None:
    if not isinstance(EXAMPLES[kind].mobility(LIMITS), Holonomic):
        with pytest.raises(InadmissibleTwist):
            EXAMPLES[kind].inverse(Twist(1.0, math.nan, 0.0))


@every_drive
@fast
@given(seed=st.integers(0, 10**6))
def test_rolling_the_actuator_law_forward_gives_the_path_back(kind, seed) -> None:
    drive = EXAMPLES[kind]
    path = smooth_path(drive, seed, n=301)
    rng = np.random.default_rng(seed)
    law = drive.actuators(path, rng.uniform(-3, 3, len(drive.steered_names)))
    sdot = rng.uniform(0.1, 2.0, (len(path.s), 1))
    twist, slip = drive.forward(law.wheel * sdot, law.steering, law.steering_derivative * sdot)
    np.testing.assert_allclose(twist, path.tangent * sdot, atol=1e-11, rtol=0)
    assert slip.max() < 1e-12


@every_drive
@fast
@given(seed=st.integers(0, 10**6))
def test_the_actuator_law_is_the_inverse_at_every_sample(kind, seed) -> None:
    drive = EXAMPLES[kind]
    path = smooth_path(drive, seed, n=101)
    law = drive.actuators(path)
    for i in range(0, 101, 10):
        state = drive.inverse(Twist(*path.tangent[i]), law.steering[i])
        np.testing.assert_allclose(law.wheel[i], state.rates, atol=1e-10, rtol=0)
        np.testing.assert_allclose(law.steering[i], state.steering, atol=1e-12, rtol=0)
        if not drive.steers_at_rest:
            np.testing.assert_allclose(law.steering_derivative[i], state.steering_rates, atol=1e-10, rtol=0)


@every_drive
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_derivatives_of_the_law_are_those_of_its_values(kind, seed) -> None:
    drive = EXAMPLES[kind]
    path = smooth_path(drive, seed)
    law = drive.actuators(path)
    h = path.s[1] - path.s[0]
    for value, derivative in (
        (law.wheel, law.wheel_derivative),
        (law.steering, law.steering_derivative),
    ):
        error = np.abs(central_difference(value, h) - derivative[3:-3])
        # Relative, as a caster that begins across the path swings round within its own offset.
        assert error.max(initial=0.0) < 1e-7 * (1 + np.abs(derivative).max(initial=0.0))


@every_drive
@fast
@given(seed=st.integers(0, 10**6))
def test_steering_is_continuous_along_a_path(kind, seed) -> None:
    drive = EXAMPLES[kind]
    path = smooth_path(drive, seed, n=501)
    law = drive.actuators(path)
    steps = np.abs(np.diff(law.steering, axis=0)) / np.diff(path.s)[:, None]
    slopes = np.maximum(np.abs(law.steering_derivative[1:]), np.abs(law.steering_derivative[:-1]))
    assert (steps <= 1.2 * slopes + 0.2).all()


@every_drive
def test_a_path_of_one_sample_has_a_law(kind) -> None:
    path = BodyPath(np.zeros(1), np.full(1, 0.3), np.array([[1.0, 0.0, 0.2]]), np.zeros((1, 3)))
    law = EXAMPLES[kind].actuators(path)
    assert law.wheel.shape == law.wheel_derivative.shape == (1, len(EXAMPLES[kind].wheel_names))
    assert law.steering.shape == law.steering_derivative.shape == (1, len(EXAMPLES[kind].steered_names))


@every_drive
def test_the_law_leaves_its_inputs_alone_and_does_not_share_them(kind) -> None:
    drive = EXAMPLES[kind]
    path = smooth_path(drive, 1, n=11)
    start = np.full(len(drive.steered_names), 0.2)
    law = drive.actuators(path, start)
    for out in (law.wheel, law.wheel_derivative, law.steering, law.steering_derivative):
        assert not any(np.shares_memory(out, given) for given in (path.tangent, path.heading, start))
    assert (start == 0.2).all()
