"""Hands that are held in the world or relative to the base: their rows, their motions, and whole robots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config import load_config
from lgmpc.config.build import build_controller, build_robot, prepare
from lgmpc.costs import StageSymbols
from lgmpc.errors import ConfigError, InputError
from lgmpc.wbc import HandMotion, HandTask, WholeBodyTerms
from lgmpc.wbc.settings import HandMove, HandSettings
from tests.support.samples import b1_with_arm

PLACES = ("world", "base")
CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def hand(relative_to: str, **settings: Any) -> tuple[HandTask, HandSettings]:
    chosen = HandSettings(frame="gripperStator", relative_to=relative_to, **settings)
    return HandTask(b1_with_arm(), chosen), chosen


def state(seed: int) -> tuple[Any, Any]:
    robot, rng = b1_with_arm(), np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.q_reference, 0.3 * rng.standard_normal(robot.nv))
    return q, rng.standard_normal(robot.nv)


@pytest.mark.parametrize("relative_to", PLACES)
def test_velocity_and_drift_are_derivatives_of_the_pose(relative_to: str) -> None:
    robot, (task, _), (q, v) = b1_with_arm(), hand(relative_to), state(1)
    qs, vs = ca.SX.sym("q", robot.nq), ca.SX.sym("v", robot.nv)
    s = StageSymbols(robot.symbolic, ca.vertcat(qs, vs), {})
    rows = ca.Function("rows", [qs, vs], [task.velocity(s), task.drift(s), task.jacobian(s)])
    velocity, drift, jacobian = (np.array(each).squeeze() for each in rows(q, v))
    h, data = 1e-6, robot.model.createData()
    ahead, behind = (pin.integrate(robot.model, q, sign * h * v) for sign in (1.0, -1.0))
    one, other = (task.placement(robot, data, each) for each in (ahead, behind))
    moved = np.concatenate([one.translation - other.translation, pin.log3(one.rotation @ other.rotation.T)]) / (2 * h)
    np.testing.assert_allclose(velocity, moved, atol=1e-7)
    np.testing.assert_allclose(jacobian @ v, velocity, atol=1e-12)
    faster, slower = (np.array(rows(each, v)[0]).squeeze() for each in (ahead, behind))
    np.testing.assert_allclose(drift, (faster - slower) / (2 * h), atol=1e-6)


@pytest.mark.parametrize("relative_to", PLACES)
def test_errors_lead_to_the_target_and_are_limited(relative_to: str) -> None:
    robot, (task, settings), (q, v) = b1_with_arm(), hand(relative_to), state(2)
    qs = ca.SX.sym("q", robot.nq)
    position, rotation = ca.SX.sym("position", 3), ca.SX.sym("rotation", 9)
    s = StageSymbols(robot.symbolic, ca.vertcat(qs, v), {"position": position, "rotation": rotation})
    error = ca.Function("error", [qs, position, rotation], [task.error(s)])
    pose, turn = task.placement(robot, robot.model.createData(), q), np.array([0.1, -0.2, 0.3])
    wanted = (pin.exp3(turn) @ pose.rotation).ravel()
    near = np.array(error(q, pose.translation + [0.01, 0.0, -0.02], wanted)).squeeze()
    np.testing.assert_allclose(near, [0.01, 0.0, -0.02, *turn], atol=1e-9)
    far = np.array(error(q, pose.translation + [0.0, 3.0, 4.0], wanted)).squeeze()
    np.testing.assert_allclose(far[:3], settings.largest_error_m * np.array([0.0, 0.6, 0.8]), atol=1e-9)


def test_poses_in_the_world_are_relative_to_the_base_at_the_start() -> None:
    """Of a robot at (3, -2, 0.5) with a heading of 2 rad: the target ends 0.7 m ahead of where it stood."""
    robot, (task, settings) = b1_with_arm(), hand("world")
    q = robot.q_reference.copy()
    q[:7] = pin.SE3ToXYZQUAT(pin.SE3(pin.utils.rotate("z", 2.0), np.array([3.0, -2.0, 0.5])))
    terms = WholeBodyTerms(robot)
    terms.update(q, np.zeros(robot.nv))
    task.stand(robot, terms)
    motion = HandMotion(robot, task, settings)
    motion.begin(terms)
    hand_now, target_now = motion.poses(q)
    np.testing.assert_allclose(hand_now, target_now, atol=1e-12)
    motion.move(HandMove(at_s=1.0, duration_s=0.5, position_m=(0.7, 0.1, 0.2), rpy_deg=(0.0, 90.0, 0.0)))
    path, rates = [], []
    for time in np.arange(0.99, 1.52, 1e-3):
        motion.update(float(time), 1e-3, q)
        path.append(task.target.position.copy())
        rates.append(task.target.velocity.copy())
    end = motion.poses(q)[1]
    np.testing.assert_allclose(end[:3], q[:3] + pin.utils.rotate("z", 2.0) @ [0.7, 0.1, 0.2], atol=1e-12)
    turned = pin.utils.rotate("z", 2.0) @ pin.utils.rotate("y", np.pi / 2)
    np.testing.assert_allclose(pin.Quaternion(end[3:]).matrix(), turned, atol=1e-12)
    steps = np.diff(path, axis=0) / 1e-3
    np.testing.assert_allclose(steps, np.array(rates)[1:, :3], atol=0.02)
    np.testing.assert_allclose([*rates[0], *rates[-1]], 0.0, atol=1e-12)


def test_a_robot_steps_to_where_its_hand_reaches_and_stands_there() -> None:
    """The base as its hand: 0.2 m ahead, of which 0.05 are within reach."""
    hand = "{frame: base_link, relative_to: world, weight: 0.01, rotation_weight: 0, reach_m: 0.05"
    moves = "moves: [{at_s: 0.1, duration_s: 0.5, position_m: [0.2, 0, 0]}]"
    changes = [f"wbc.hands=[{hand}, {moves}}}]", "duration_s=1.9"]
    log = prepare(load_config(CONFIGS / "solo12_stand.yaml", changes)).run(lambda progress: None).log
    assert log.com[-1, 0] - log.com[0, 0] == pytest.approx(0.15, abs=0.01)
    assert not log.stance.all() and log.stance[log.time > 1.8].all()


@pytest.mark.slow
def test_a_hand_stays_in_the_world_while_the_robot_trots() -> None:
    """At 0.3 m/s, elsewhere and turned, in the plant that the config's own test does not use."""
    changes = ["plant.kind=pinocchio", "duration_s=2.5", "world={start_m: [3, -2], start_yaw_deg: 130, height_m: -0.7}"]
    result = prepare(load_config(CONFIGS / "b1_z1_hold.yaml", changes)).run(lambda progress: None)
    log, metrics = result.log, result.metrics
    assert metrics is not None and log.hand_poses is not None
    assert metrics.max_hand_error_m is not None and metrics.max_hand_error_m < 1e-3
    assert metrics.max_hand_rotation_deg is not None and metrics.max_hand_rotation_deg < 0.1
    assert np.ptp(np.linalg.norm(log.base_pose[:, :2] - log.base_pose[0, :2], axis=1)) > 0.4
    assert np.abs(log.hand_poses[:, 0, :3] - log.hand_poses[0, 0, :3]).max() < 1e-3


@pytest.mark.slow
def test_a_pull_at_the_hand_is_observed_and_resisted() -> None:
    """20 N downward while it trots; after half a second the hand is back within a millimetre of its place."""
    pull = "pushes=[{body: j2s6s200_link_6, time_s: 1.5, duration_s: 3.0, impulse_ns: [0, 0, -60]}]"
    changes = ["duration_s=3.5", "wbc.hands.0.moves=[]", pull, "gate.steady_from_s=2.5"]
    session, seen = prepare(load_config(CONFIGS / "anymal_kinova_reach.yaml", changes)), []

    def watch(tick: Any) -> bool:
        if tick.sample.time > 2.0:
            seen.append(session.controller.report.external_wrench[2])  # type: ignore[attr-defined]
        return True

    session.watch = watch  # type: ignore[attr-defined]
    metrics = session.run(lambda progress: None).metrics
    assert metrics is not None and metrics.max_hand_error_m is not None and metrics.max_hand_error_m < 2e-3
    assert -26.0 < np.median(seen) < -15.0


CASES = {
    "wbc.hands=[{frame: griperStator}]": "wbc.hands.frame: .*griperStator.*Did you mean gripperStator",
    "wbc.hands=[{frame: link06}, {frame: link06}]": "tasks: got two called 'link06'",
    "wbc.hands=[{frame: link06, relative_to: trunk}]": "wbc.hands.0.relative_to.*world.*base",
    "wbc.hands=[{frame: link06, moves: [{at_s: 1.0, duration_s: 2.0}, {at_s: 2.0}]}]": "wbc.hands.0.moves.1.at_s.*3 s",
    "wbc.hands=[{frame: link06, moves: [{at_s: 1.0, position: [1, 0, 0]}]}]": "Did you mean .*position_m",
}


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("change", CASES)
def test_one_error_names_what_cannot_be_used(change: str) -> None:
    with pytest.raises((ConfigError, InputError), match=CASES[change]):
        config = load_config(CONFIGS / "b1_z1_hold.yaml", [change])
        build_controller(config, build_robot(config))
