"""Motors that lose torque, found from motions whose forces are known, and in closed loop."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config.build import prepare
from lgmpc.config.loading import load_config
from lgmpc.config.robots import build_robot
from lgmpc.control.interface import RobotState
from lgmpc.errors import InputError
from lgmpc.estimation import JointFaultMonitor
from lgmpc.robot import Robot
from lgmpc.runs import Outcome

PERIOD = 1e-3
FAULT_S = 0.3


def watched(
    robot: Robot, joint: int = 0, share: float = 1.0, wrench: np.ndarray | None = None, seconds: float = 0.6
) -> tuple[list[tuple[float, int]], np.ndarray]:
    """Return the detections (s, joint) and the shares found, of a robot whose feet push it as it trembles.

    From ``FAULT_S`` on a motor gives a share of its commanded torque, or a wrench (6,), world axes, acts on the base.
    """
    monitor, data, model = JointFaultMonitor(robot, PERIOD), robot.create_data(), robot.model
    rng = np.random.default_rng(3)
    q, v = robot.q_reference.copy(), np.zeros(robot.nv)
    phases, found = rng.uniform(0.0, 6.0, robot.nu), []
    for k in range(round(seconds / PERIOD)):
        time = PERIOD * k
        detected = monitor.update(RobotState(time, q, v))
        found += [] if detected is None else [(time, detected)]
        forces = np.tile([0.0, 0.0, 0.25 * robot.mass * 9.81], (robot.nc, 1))
        forces += 0.5 * np.sin(9.0 * time + phases).reshape(robot.nc, 3)
        pin.computeJointJacobians(model, data, q)
        pin.framesForwardKinematics(model, data, q)
        bias, mass = pin.nle(model, data, q, v).copy(), pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        pushed = np.zeros(robot.nv)
        for frame, force in zip(robot.contact_ids, forces, strict=True):
            lever = [0.0, 0.0, -robot.contact_radius]
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            pushed += jacobian[:3].T @ force + jacobian[3:].T @ np.cross(lever, force)
        if wrench is not None and time >= FAULT_S:
            pushed[:6] += wrench  # of a level base
        joints = 3.0 * np.cos(8.0 * time + phases)
        base = np.linalg.solve(mass[:6, :6], pushed[:6] - bias[:6] - mass[:6, 6:] @ joints)
        acceleration = np.concatenate([base, joints])
        torques = mass[6:] @ acceleration + bias[6:] - pushed[6:]
        if time >= FAULT_S:
            torques[joint] *= monitor.shares[joint] / share  # commanded for what the motor is known to give
        monitor.expect(torques)
        q, v = pin.integrate(model, q, PERIOD * v), v + PERIOD * acceleration
    return found, monitor.shares


@pytest.mark.parametrize("share", [0.5, 0.65])
@pytest.mark.parametrize("joint", ["FL_KFE", "HR_KFE", "FR_HAA"])
def test_a_weak_motor_is_found_with_its_share(solo12: Robot, joint: str, share: float) -> None:
    index = solo12.joint_names.index(joint)
    found, shares = watched(solo12, index, share)
    assert found and found[0][1] == index and FAULT_S < found[0][0] < FAULT_S + 0.2
    assert shares[index] == pytest.approx(share, abs=0.05)
    assert np.delete(shares, index).min() == 1.0


@pytest.mark.parametrize("force", [(10.0, 0.0, 0.0), (0.0, -10.0, 0.0), (0.0, 0.0, -6.0), (7.0, 7.0, 0.0)])
def test_a_push_is_no_fault(solo12: Robot, force: tuple[float, float, float]) -> None:
    assert watched(solo12, wrench=np.array([*force, 0.0, 0.0, 0.0]))[0] == []
    assert watched(solo12)[0] == []


@pytest.mark.parametrize("plant", ["mujoco", "pinocchio"])
@pytest.mark.parametrize(("joint", "lies_s"), [("HR_KFE", 1.4), ("FR_HAA", 2.7)])
def test_without_a_motor_a_standing_robot_lies_down(plant: str, joint: str, lies_s: float) -> None:
    """Without a knee at once, before it topples; without a hip its foot still carries, and it takes its time."""
    faults = f"plant.actuators.faults=[{{joint: {joint}, at_s: 0.5}}]"
    session = prepare(load_config("solo12_stand", [faults, f"plant.kind={plant}", "duration_s=3.2"]))
    result = session.run(lambda progress: None)
    log, metrics = result.log, result.metrics
    assert metrics is not None and metrics.modes is not None and log.motor_shares is not None
    shares = dict(zip(log.joint_names.tolist(), log.motor_shares[-1].tolist(), strict=True))
    assert shares.pop(joint) == 0.0 and set(shares.values()) == {1.0}
    assert log.time[np.argmax(log.motor_shares.min(axis=1) == 0.0)] < 0.6
    lies = log.mode == 0
    assert metrics.modes.descents == 1 and lies[-1] and log.time[np.argmax(lies)] < lies_s
    assert metrics.max_tilt_deg < 12.0 and metrics.falls == 0


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["mujoco", "pinocchio"])
def test_with_a_weak_knee_it_trots_on_and_without_another_it_lies_down(plant: str) -> None:
    result = prepare(load_config("solo12_motor_fault", [f"plant.kind={plant}"])).run(lambda progress: None)
    log, shares = result.log, result.log.motor_shares
    assert shares is not None and result.verdict.outcome is Outcome.PASS, result.verdict.reasons
    weak, dead = (log.joint_names.tolist().index(name) for name in ("FL_KFE", "HR_KFE"))
    assert log.time[np.argmax(shares[:, weak] < 1.0)] < 2.2 and log.time[np.argmax(shares[:, dead] == 0.0)] < 5.2
    assert shares[-1, weak] == pytest.approx(0.5, abs=0.05) and np.delete(shares[-1], [weak, dead]).min() == 1.0
    walks = (log.time > 3.0) & (log.time < 5.0)
    assert np.mean(log.v[walks, 0]) == pytest.approx(0.4, abs=0.03) and log.tilt_deg[walks].max() < 4.0


def test_legs_of_two_joints_are_refused() -> None:
    with pytest.raises(InputError, match="got solo8; expected .* legs of three joints"):
        JointFaultMonitor(build_robot(load_config("solo8_velocity")), PERIOD)


def test_a_fault_of_an_unknown_joint_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"plant.actuators.faults.0.joint.*FL_KFI.*FL_KFE"):
        prepare(load_config("solo12_stand", ["plant.actuators.faults=[{joint: FL_KFI, at_s: 1.0}]"]))
