"""Figures of merit of legged motions, recomputed by Pinocchio from states and torques."""

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.lie import so3
from lgmpc.locomotion.sequence import GaitGrid
from lgmpc.ocp import Trajectory
from lgmpc.problems import motion
from lgmpc.problems.footsteps import Footsteps
from lgmpc.problems.ground import BodySpheres, ProblemGround
from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class LeggedFigures:
    """Figures of a robot's motion in a gait.

    Attributes:
        robot: the robot.
        grid: the intervals.
        steps: reference positions of the feet.
        goal: (nx,) reference state at the end.
        friction: coefficient of the ground.
        ground: the ground, and where the robot starts on it.
    """

    robot: Robot
    grid: GaitGrid
    steps: Footsteps
    goal: Array
    friction: float
    ground: ProblemGround

    def measure(self, trajectory: Trajectory) -> dict[str, float]:
        """Return all figures by name, which ends in the unit.

        forward_distance_m, goal_error_m, goal_rotation_error_deg: of the base at the end, from its start and its goal.
        final_speed_m_s: of the centre of mass. tilt_deg: largest angle of the base's z axis from the ground's normal.
        clearance_m: least distance of the collision shapes and of the shanks from the ground; foot_depth_m: of feet in
        the air in it. com_rise_m: highest centre of mass above its first. swing_height_m: apex of the lowest swing
        above its line along the normal. foot_height_error_m: of feet in the air from their references, along the normal
        as well. foothold_error_m, touchdown_speed_m_s: at touchdown. slip_m: largest distance of a foot on the ground
        from its touchdown position. friction_ratio: largest ratio of tangential force to its limit; normal_force_n: the
        smallest; peak_force_n: the largest. impact_cone_violation_ns: of impulses outside the cone. effort_ratio,
        joint_velocity_ratio: largest ratios to the limits. joint_limit_violation_rad: beyond the limits.
        dynamics_misfit_ratio: residual of the equations of motion over the weight, at impacts over the impulse of the
        weight in a second. flight_com_error_m, flight_spin_ratio: see :meth:`flight`.
        """
        robot, grid, xs = self.robot, self.grid, trajectory.xs
        feet, planned = motion.contact_positions(robot, xs), self.steps.positions(grid.times)
        found, moving = motion.reactions(robot, trajectory, grid.durations, grid.flags), ~grid.impacts
        wrenches = found.wrenches @ self.ground.axes  # in those of the ground
        pressed = wrenches[grid.flags & moving[:, None]]
        struck = wrenches[grid.flags & grid.impacts[:, None]]
        rates = np.abs(xs[:, robot.nq :][:, robot.joint_v])
        weight = robot.weight
        normal = self.ground.axes[:, 2]
        raised = np.abs((feet - planned)[:-1][~grid.flags] @ normal)
        rotations = so3.from_quaternion.unchecked(xs[:, 3:7])
        start, goal = self.ground.placed(robot.x_reference[None])[0], self.goal
        turned = so3.from_quaternion.unchecked(goal[3:7]).T @ rotations[-1]
        com = motion.com_positions(robot, xs) @ robot.up
        com_error, spin = self.flight(xs)
        return {
            "forward_distance_m": float((xs[-1, :3] - start[:3]) @ self.ground.axes[:, 0]),
            "goal_error_m": float(np.linalg.norm(xs[-1, :3] - goal[:3])),
            "goal_rotation_error_deg": math.degrees(float(np.linalg.norm(pin.log3(turned)))),
            "final_speed_m_s": motion.com_speed(robot, xs[-1]),
            "tilt_deg": math.degrees(float(np.arccos(np.clip(rotations[:, :, 2] @ normal, -1.0, 1.0)).max())),
            "clearance_m": float(BodySpheres.measured(robot).distances(robot, xs, self.ground.world).min()),
            "foot_depth_m": self._foot_depth(feet),
            "com_rise_m": float(com.max() - com[0]),
            "swing_height_m": self._swing_height(feet),
            "foot_height_error_m": float(raised.max(initial=0.0)),
            "foothold_error_m": self._foothold_error(feet),
            "touchdown_speed_m_s": self._touchdown_speed(xs),
            "slip_m": self._slip(feet),
            "friction_ratio": float(motion.friction_use(pressed, self.friction).max(initial=0.0)),
            "normal_force_n": float(pressed[:, 2].min(initial=np.inf)),
            "peak_force_n": float(pressed[:, 2].max(initial=0.0)),
            "impact_cone_violation_ns": float(_outside_cone(struck, self.friction).max(initial=0.0)),
            "effort_ratio": float((np.abs(trajectory.us[moving]) / robot.effort_limit).max()),
            "joint_velocity_ratio": float((rates / robot.velocity_limit).max()),
            "joint_limit_violation_rad": motion.joint_limit_violation(robot, xs),
            "dynamics_misfit_ratio": float(found.misfit.max()) / weight,
            "flight_com_error_m": com_error,
            "flight_spin_ratio": spin,
        }

    def forces(self, trajectory: Trajectory) -> Array:
        """Return (N, nc, 3) the forces on the feet, world axes, N; zero over an impact, which has impulses."""
        forces = motion.reactions(self.robot, trajectory, self.grid.durations, self.grid.flags).wrenches
        forces[self.grid.impacts] = 0.0
        return forces

    def flight(self, xs: Array) -> tuple[float, float]:
        """Return the errors of the momenta in a flight without contacts; zeros if there is none.

        The distance of the centre of mass from the parabola through take-off and landing, m, and the change of the
        angular momentum about it, over that of a turn in the flight's time. Both are errors of the integrator, of first
        order in the intervals' length.
        """
        robot, times = self.robot, self.grid.times
        data, com, spin = robot.create_data(), motion.com_positions(robot, xs), motion.spins(robot, xs)
        pin.ccrba(robot.model, data, robot.q_reference, np.zeros(robot.nv))
        inertia = float(np.linalg.eigvalsh(data.Ig.inertia).max())
        worst = [0.0, 0.0]
        for first, last in _runs(self.grid.flight):
            nodes = np.arange(first, last + 1)
            t, whole = times[nodes] - times[first], times[last] - times[first]
            chord = com[first] + (t / whole)[:, None] * (com[last] - com[first])
            parabola = chord - (t * (whole - t) / 2)[:, None] * robot.gravity
            away = np.linalg.norm(com[nodes] - parabola, axis=1).max()
            change = np.linalg.norm(spin[nodes] - spin[first], axis=1).max()
            worst = [max(worst[0], float(away)), max(worst[1], float(change) * whole / (2 * math.pi * inertia))]
        return worst[0], worst[1]

    def _swing_height(self, feet: Array) -> float:
        """Return the apex of the lowest swing above the straight line between its ends."""
        apexes = []
        for i, down in enumerate(self.grid.flags.T):
            for first, last in _runs(~down):
                fraction = (self.grid.times[first : last + 1] - self.grid.times[first])[:, None]
                line = feet[first, i] + fraction / fraction[-1] * (feet[last, i] - feet[first, i])
                apexes.append(float(((feet[first : last + 1, i] - line) @ self.ground.axes[:, 2]).max()))
        return min(apexes, default=0.0)

    def _foot_depth(self, feet: Array) -> float:
        """Return the largest depth of a foot in the air below the ground's surface, m."""
        found = self.ground.world.distance(feet[:-1][~self.grid.flags])[0] - self.robot.foot_points.radius
        return float(-found.min(initial=0.0))

    def _foothold_error(self, feet: Array) -> float:
        planned = self.steps.positions(self.grid.times)[:-1]
        return float(np.linalg.norm((feet[:-1] - planned)[self.grid.touchdowns], axis=1).max(initial=0.0))

    def _touchdown_speed(self, xs: Array) -> float:
        robot, fastest = self.robot, 0.0
        model, data = robot.model, robot.create_data()
        for k in np.flatnonzero(self.grid.impacts):
            pin.forwardKinematics(model, data, xs[k, : robot.nq], xs[k, robot.nq :])
            for i in np.flatnonzero(self.grid.touchdowns[k]):
                velocity = pin.getFrameVelocity(model, data, robot.contact_ids[i], pin.LOCAL)
                fastest = max(fastest, float(np.linalg.norm(velocity.linear)))
        return fastest

    def _slip(self, feet: Array) -> float:
        """Return the largest distance of a foot on the ground from its touchdown position, m."""
        slip = 0.0
        for i, down in enumerate(self.grid.flags.T):
            for first, last in _runs(down):
                slip = max(slip, float(np.linalg.norm(feet[first : last + 1, i] - feet[first, i], axis=1).max()))
        return slip


def _runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return the first and the last node of each sequence of consecutive intervals whose flag is set."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def _outside_cone(forces: Array, friction: float) -> Array:
    """Return (n,) the violation of the friction cone, tensile forces included."""
    beyond = np.linalg.norm(forces[:, :2], axis=1) - friction * forces[:, 2]
    return np.maximum(np.maximum(beyond, -forces[:, 2]), 0.0)
