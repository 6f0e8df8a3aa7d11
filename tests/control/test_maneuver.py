"""Manoeuvres: sampling and placing of a motion against the robot's own kinematics; what is refused."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.control.maneuver import Maneuver
from lgmpc.control.performance import Performance
from lgmpc.control.reference import MotionTasks
from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.timegrid import TimeGrid
from lgmpc.wbc import WholeBodyController, WholeBodySettings, WholeBodyTerms
from tests.support.displaced import DISPLACEMENTS, Displacement

PERIOD = 1e-3
NOWHERE = Displacement.of((0.0, 0.0, 0.0))
TIMES = np.array([0.0, 0.1, 0.2, 0.2, 0.35])
FLAGS = np.array([[True] * 4, [False] * 4, [True] * 4, [True] * 4])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
            contact_radius_m=0.016,
            posture="standing",
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad=(-3.0, 3.0),
        )
    )


def states(robot: Robot) -> np.ndarray:
    """Five states: rest, two in motion, the second of them with two velocities (an impact), rest."""
    rng = np.random.default_rng(3)
    rest = np.concatenate([robot.q_reference, np.zeros(robot.nv)])
    found = [rest]
    for velocity in (0.5, 0.5):
        dq, v = 0.1 * rng.standard_normal(robot.nv), velocity * rng.standard_normal(robot.nv)
        found.append(np.concatenate([pin.integrate(robot.model, robot.q_reference, dq), v]))
    after = np.concatenate([found[-1][: robot.nq], 0.1 * found[-1][robot.nq :]])
    return np.array([*found, after, rest])


def sampled(robot: Robot, xs: np.ndarray, flags: np.ndarray = FLAGS) -> Maneuver:
    return Maneuver.of("test", robot, TIMES, xs, flags, np.ones((4, 4, 3)) * flags[:, :, None], PERIOD)


def test_samples_are_on_the_trajectory_and_agree_with_the_robots_kinematics(robot: Robot) -> None:
    xs = states(robot)
    found, terms = sampled(robot, xs), WholeBodyTerms(robot)
    assert len(found.q) == 351
    for row, state in ((0, xs[0]), (100, xs[1]), (200, xs[3]), (350, xs[4])):  # after the impact at 0.2 s
        np.testing.assert_allclose(found.q[row], state[: robot.nq], atol=1e-12)
        np.testing.assert_allclose(found.v[row], state[robot.nq :], atol=1e-9)
        terms.update(found.q[row], found.v[row])
        np.testing.assert_allclose(found.momentum[row], terms.momentum, atol=1e-9)
    for row in (0, 57, 150, 300):
        terms.update(found.q[row], found.v[row])
        np.testing.assert_allclose(found.com[row], terms.com, atol=1e-12)
        np.testing.assert_allclose(found.points[row], terms.contact_points, atol=1e-12)
        np.testing.assert_allclose(found.rotation[row], terms.rotation, atol=1e-12)
    assert found.flights == [(100, 200)]
    # The mean acceleration of an interval, and the rate of its momentum, lead from its beginning to its end.
    np.testing.assert_allclose(0.1 * found.acceleration[150], xs[2, robot.nq :] - xs[1, robot.nq :], atol=1e-12)
    np.testing.assert_allclose(found.momentum[199] - found.momentum[101], 0.098 * found.momentum_rate[150], atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.7, np.pi - 1e-9, -2.0])
def test_a_placed_manoeuvre_is_the_same_motion_turned_and_shifted(robot: Robot, yaw: float) -> None:
    own, terms = sampled(robot, states(robot)), WholeBodyTerms(robot)
    place = np.array([1.0, -2.0, 0.3])
    turn = pin.AngleAxis(yaw, np.array([0.0, 0.0, 1.0])).matrix()
    feet = (own.points[0] - own.points[0].mean(axis=0)) @ turn.T + place
    placed = own.placed(feet, turn, robot.up)
    np.testing.assert_allclose(placed.points[0], feet, atol=1e-12)
    for row in (0, 57, 150, 300):
        terms.update(placed.q[row], placed.v[row])  # base velocities are in the base's axes
        np.testing.assert_allclose(placed.com[row], terms.com, atol=1e-12)
        np.testing.assert_allclose(placed.points[row], terms.contact_points, atol=1e-12)
        np.testing.assert_allclose(placed.rotation[row], terms.rotation, atol=1e-12)
        np.testing.assert_allclose(placed.momentum[row], np.kron(np.eye(2), turn) @ own.momentum[row], atol=1e-12)
        np.testing.assert_allclose(placed.forces[row], own.forces[row] @ turn.T, atol=1e-12)
    again = placed.placed(own.points[0], np.eye(3), robot.up)  # a plan that begins turned
    np.testing.assert_allclose(again.q[:, :3], own.q[:, :3], atol=1e-12)
    np.testing.assert_allclose(again.rotation, own.rotation, atol=1e-12)


def test_what_does_not_lead_from_standing_to_standing_is_refused(robot: Robot) -> None:
    xs = states(robot)
    for flags, words in ((FLAGS[[1, 0, 2, 3]], "air at its beginning"), (FLAGS[[0, 2, 3, 1]], "air at its end")):
        with pytest.raises(InputError, match=words):
            sampled(robot, xs, flags)
    moving, bent = xs.copy(), xs.copy()
    moving[-1, robot.nq] = 0.3
    with pytest.raises(InputError, match=r"a speed of 0\.3 at its end; expected rest"):
        sampled(robot, moving)
    bent[0, 7] += 0.4
    with pytest.raises(InputError, match=r"FL_HAA 0\.4 rad from the reference posture at its beginning"):
        sampled(robot, bent)
    with pytest.raises(InputError, match="36 entries of the state and 4 contacts; expected 37 and 4"):
        sampled(robot, xs[:, 1:])


def test_a_landing_waits_on_stretched_legs_and_stands(robot: Robot) -> None:
    landing, terms = Maneuver.landing(robot, PERIOD), WholeBodyTerms(robot)
    (begin, end), *others = landing.flights
    assert (begin, others) == (0, []) and landing.longest_wait_s == 1.0
    longer = landing.q[0, 2] - robot.q_reference[2]
    assert 0.03 < longer < 0.1  # of 0.24 m
    np.testing.assert_allclose(landing.points[0, :, :2], landing.points[-1, :, :2], atol=1e-3)  # below the same hips
    np.testing.assert_allclose(landing.q[-1], robot.q_reference, atol=1e-9)
    assert landing.stance[end:].all() and not landing.v.any()
    np.testing.assert_allclose(landing.forces[-1].sum(axis=0), [0.0, 0.0, 9.81 * robot.mass], atol=1e-9)
    terms.update(robot.q_reference, np.zeros(robot.nv))
    np.testing.assert_allclose(landing.com[-1], terms.com, atol=1e-9)


def hop(robot: Robot, move: Displacement) -> Maneuver:
    """A hop of rigid legs at 1 m/s, from a displaced reference posture."""
    times = np.arange(0.0, 0.505, 0.01)
    fall = times - 0.1
    height = np.where(times < 0.1, 5.0 * times**2, 0.05 + fall - 4.905 * fall**2)
    speed = np.where(times < 0.1, 10.0 * times, 1.0 - 9.81 * fall)
    height, speed = (np.where(times > 0.3, each[30] * (0.5 - times) / 0.2, each) for each in (height, speed))
    xs = np.tile(robot.x_reference, (len(times), 1))
    xs[:, 2], xs[:, robot.nq + 2] = xs[:, 2] + height, speed
    xs[:, : robot.nq] = move.poses(xs[:, : robot.nq])
    flags = np.repeat((times < 0.1 - 1e-9) | (times > 0.3 - 1e-9), 4).reshape(-1, 4)[:-1]
    forces = move.vectors(np.tile([1.0, 0.0, 6.0], (len(flags), 4, 1)) * flags[:, :, None])
    return Maneuver.of("hop", move.robot(robot), times, xs, flags, forces, PERIOD)


def performed(robot: Robot, plan: Displacement, move: Displacement) -> dict[str, np.ndarray]:
    """Targets of a hop, planned somewhere, of a body that is thrown as high from somewhere else, but 10 % faster."""
    moved = move.robot(robot)
    wbc = WholeBodyController(moved, WholeBodySettings())
    motion, contacts = MotionReference.standing(moved, 10, np.zeros(3)), ContactHorizon.allocate(10, 4)
    q, v, present = robot.q_reference.copy(), np.zeros(robot.nv), None
    start, found = q[2], []
    for tick in range(600):
        wbc.sense(move.poses(q), v)
        present = Performance(hop(robot, plan), wbc, MotionTasks.of(wbc.tasks), moved) if present is None else present
        flies = not present.stance.any()
        present.advance(np.full(4, not flies or q[2] < start + 0.04))
        present.write_balance()
        if tick % 5 == 0:
            present.write_horizon(TimeGrid(0.02, len(contacts.flags)), 0.5, motion, contacts)
        com, base = wbc.tasks["com"].target, wbc.tasks["base_orientation"].target
        rows = {
            "com": com.position, "com_velocity": com.velocity, "com_acceleration": com.acceleration,
            "rotation": base.rotation, "base": present.base, "forces": wbc.contacts.target_forces,
            "momentum_rate": wbc.tasks["angular_momentum"].target.rate, "turning": motion.angular_velocity,
            "joint_rates": wbc.tasks["posture"].target.velocity, "horizon": motion.com, "points": contacts.points,
            "flags": contacts.flags, "stance": present.stance, "state": np.array([present.done, present.upright]),
        }  # fmt: skip
        found.append({name: np.array(value) for name, value in rows.items()})
        if present.done:
            break
        v[2] = v[2] - 9.81 * PERIOD if flies else 11.0 * PERIOD * tick if tick < 200 else 0.0
        q[2] += PERIOD * v[2]
    return {name: np.array([each[name] for each in found]) for name in found[0]}


@pytest.mark.usefixtures("interpreted")
def test_a_manoeuvre_is_performed_alike_wherever_down_is(robot: Robot) -> None:
    """Down is tilted, and it begins turned and shifted; a thrown body takes off before the plan's 0.1 s."""
    tilted, turn = DISPLACEMENTS["tilted"], Displacement.of((0.4, -0.2, 0.1), 50.0)
    there = Displacement(tilted.rotation @ turn.rotation, tilted.points(turn.translation))
    level, found = performed(robot, NOWHERE, NOWHERE), performed(robot, tilted, there)
    # It rises by 5.5 t^2 and at 11 t, and from there to the planned 0.101 m; it touches the ground at 0.04 m.
    assert np.flatnonzero(np.diff(level["stance"].all(axis=1))).tolist() == [93, 314]
    for name, values in level.items():
        expected = values
        if name in ("com", "horizon", "points"):
            expected = there.points(values)
        elif name == "rotation":
            expected = there.rotation @ values
        elif name == "base":
            expected = there.poses(values)
        elif name in ("com_velocity", "com_acceleration", "forces", "momentum_rate", "turning"):
            expected = there.vectors(values)
        np.testing.assert_allclose(found[name], expected, atol=1e-9, err_msg=name)
