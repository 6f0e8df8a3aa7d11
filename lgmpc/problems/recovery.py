"""A multirotor that tumbles, or hangs in the air upside down, turns upright and hovers where it began.

Its attitude may pass through any angle on the way: nothing in the problem is written in angles. States are drawn
together on SE(3), whose logarithm is only ever taken of the small turn from one node to the next, and the cost measures
attitudes by matrices (Psi of the chapter), which have no branch at rotation pi. In roll, pitch and yaw the same motion
jumps at pitch 90 degrees, and in the rotation vector from the goal at rotation pi.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.actions import MultibodyAction, RungeKutta4
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FrameRotationMatrix, FrameTranslation, FrameVelocity
from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.attitude import angle_between, rotation_of, rpy_of, tilt
from lgmpc.problems.multirotor import Multirotor, MultirotorSettings, thrust_figures, turning_guess
from lgmpc.problems.scenario import Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["RecoverySettings", "RecoveryWeights", "build_recovery"]


@dataclass(frozen=True)
class RecoveryWeights:
    """Weights of the cost on the way (per second) and at the end.

    Attributes:
        position: from where it began, on the way, 1/m2.
        rotation: from the attitude of the goal, on the way, 1/rad2 for small angles.
        speed: on the way, 1/(m/s)2 and 1/(rad/s)2.
        thrust: of each rotor from hovering, 1/N2.
        goal: all deviations of the last state.
    """

    position: float = 1.0
    rotation: float = 1.0
    speed: float = 1e-2
    thrust: float = 1e-2
    goal: float = 1e3


@dataclass(frozen=True)
class RecoverySettings:
    """The vehicle, its first state and the grid.

    Attributes:
        rotors: of the vehicle.
        position: (3,) where it begins, and should end, world axes, m.
        rotation_deg: (3,) its attitude at first as a rotation vector, degrees: ``[180, 0, 0]`` is upside down.
        velocity: (3,) at first, body axes, m/s.
        angular_velocity: (3,) at first, body axes, rad/s.
        goal_rotation_deg: (3,) attitude at the end, degrees. Its length sets which way the guess turns: from
            ``[0, 150, 0]`` to ``[0, 360, 0]``, which is level, it goes on over the back.
        nodes: number of intervals.
        node_duration: length of each, s.
        weights: of the cost.
    """

    rotors: MultirotorSettings
    position: tuple[float, float, float] = (0.0, 0.0, 5.0)
    rotation_deg: tuple[float, float, float] = (0.0, 180.0, 0.0)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    goal_rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    nodes: int = 100
    node_duration: float = 0.025
    weights: RecoveryWeights = RecoveryWeights()


def build_recovery(robot: Robot, settings: RecoverySettings) -> Scenario:
    """Return the problem; its thrusts are bounds on the controls, and the guess turns evenly for half of the time.

    Figures: ``final_tilt_deg``, ``final_error_m``, ``final_speed_m_s``, ``final_rate_rad_s``; ``height_lost_m``, the
    most below the start; ``attitude_step_deg``, the largest turn from a node to the next, beside what two charts make
    of the same motion: ``rpy_jump_deg``, the largest change of roll, pitch or yaw from a node to the next, whole turns
    not counted (180 where pitch passes 90 degrees), and ``log_jump_deg``, that of the rotation vector from the goal
    (360 where the rotation passes pi); and those of :func:`lgmpc.problems.multirotor.thrust_figures`.

    Raises:
        InputError: a robot that is no vehicle of these rotors, or no duration.
    """
    s, w = settings, settings.weights
    if not s.node_duration > 0.0:
        raise InputError("node_duration", s.node_duration, "above 0 s")
    vehicle = Multirotor.of(robot, s.rotors)
    goal = so3.exp(np.radians(s.goal_rotation_deg))
    nu = len(vehicle.hover)
    costs = [
        CostItem("position", FrameTranslation(vehicle.body, s.position), w.position),
        CostItem("rotation", FrameRotationMatrix(vehicle.body, pin.Quaternion(goal).coeffs()), w.rotation),
        CostItem("velocity", FrameVelocity(vehicle.body), w.speed),
        CostItem("thrust", Control(nu, vehicle.hover), w.thrust),
    ]
    bounds = ConstraintItem("limits", Control(nu), 0.0, vehicle.max_thrust)
    problem = ShootingProblem(MultibodyAction("recovery", vehicle.dynamics, costs, [bounds], RungeKutta4()), s.nodes)
    problem.set("duration", s.node_duration)
    for name in ("position", "rotation", "velocity"):
        problem.set(f"{name}_weight", w.goal, [s.nodes])
    turned = pin.Quaternion(so3.exp(np.radians(s.rotation_deg))).coeffs()
    x0 = np.concatenate([s.position, turned, s.velocity, s.angular_velocity])
    problem.set_initial_state(x0)
    durations = np.full(s.nodes, s.node_duration)

    def figures(trajectory: Trajectory) -> dict[str, float]:
        xs, end = trajectory.xs, trajectory.xs[-1]
        rotations = [rotation_of(x) for x in xs]
        rpy = np.array([rpy_of(rotation) for rotation in rotations])
        logs = np.degrees([pin.log3(goal.T @ rotation) for rotation in rotations])
        steps = [angle_between(one, other) for one, other in zip(rotations, rotations[1:], strict=False)]
        return {
            "final_tilt_deg": float(np.degrees(tilt(end))),
            "final_error_m": float(np.linalg.norm(end[:3] - x0[:3])),
            "final_speed_m_s": float(np.linalg.norm(end[7:10])),
            "final_rate_rad_s": float(np.linalg.norm(end[10:])),
            "height_lost_m": float(max(x0[2] - xs[:, 2].min(), 0.0)),
            "attitude_step_deg": float(np.degrees(max(steps))),
            "rpy_jump_deg": float(np.degrees(np.abs(_wrapped(np.diff(rpy, axis=0))).max())),
            "log_jump_deg": float(np.linalg.norm(np.diff(logs, axis=0), axis=1).max()),
            **thrust_figures(vehicle, trajectory, durations),
        }

    end = s.nodes * s.node_duration
    turns = [(0.0, s.rotation_deg), (end / 2.0, s.goal_rotation_deg)]
    guess = turning_guess(vehicle, durations, [(0.0, s.position)], turns)
    mark = Waypoint("hover", end, np.array(s.position), goal)
    return Scenario("recovery", robot, problem, guess, durations, figures, waypoints=(mark,), controls=vehicle.controls)


def _wrapped(angle: Array) -> Array:
    """Return angles to within a turn, -pi to pi."""
    wrapped: Array = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped
