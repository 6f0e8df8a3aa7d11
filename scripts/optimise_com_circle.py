"""Solo12 draws a circle with its centre of mass: a full-body trajectory, optimised with FDDP, and checked.

The problem that mim_solvers benchmarks: radius 6.5 cm, 0.2 turns a second, 50 intervals of 20 ms, four feet on the
ground, joint torques as controls. Shows how a problem is put together: dynamics with contacts, residuals as costs, one
of them the user's own, references that change along the horizon.

    python scripts/optimise_com_circle.py
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from typing import Any

import numpy as np
import pinocchio as pin

from lgmpc import (
    CoMPosition,
    ContactControlGravity,
    ContactForwardDynamics,
    CostItem,
    Fddp,
    MultibodyAction,
    Residual,
    RobotSpec,
    ShootingProblem,
    Solution,
    StageSymbols,
    StateError,
    Trajectory,
    load_robot,
)

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
RADIUS, FREQUENCY, NODES, STEP = 0.065, 0.2, 50, 0.02


class ComSpeed(Residual):
    """A residual of one's own: velocity of the centre of mass, m/s."""

    nr = 3

    def expression(self, s: StageSymbols) -> Any:
        """Three lines, and the derivatives are exact and compiled."""
        return s.robot.vcom(s.q, s.v)


def solve() -> tuple[Solution, np.ndarray]:
    """Return the solution and the centre of mass's distance (N+1,) from the circle, m."""
    robot = load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=FEET,
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad=(-3.2, 3.2),
        )
    )
    model, data = robot.model, robot.create_data()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    feet = np.array([data.oMf[i].translation for i in robot.contact_ids])
    start = pin.centerOfMass(model, data, robot.q_reference).copy()
    phase = 2.0 * np.pi * FREQUENCY * STEP * np.arange(NODES + 1)
    circle = start + RADIUS * np.column_stack([np.cos(phase) - 1.0, np.sin(phase), np.zeros_like(phase)])

    posture = np.concatenate([np.zeros(3), np.full(3, 10.0), np.full(12, 0.5), np.full(18, 0.1)])
    dynamics = ContactForwardDynamics(model, FEET)
    costs = [
        CostItem("com", CoMPosition(), 1e4),
        CostItem("speed", ComSpeed(), 0.1),
        CostItem("posture", StateError(dynamics.state, robot.x_reference), posture),
        CostItem("effort", ContactControlGravity(robot.nu), 0.1),
    ]
    problem = ShootingProblem(MultibodyAction("circle", dynamics, costs), NODES)
    problem.set("duration", STEP)
    problem.set("contact_points", feet.ravel())
    problem.set("com_reference", circle)
    problem.x0[:] = robot.x_reference

    standing = Trajectory(np.tile(robot.x_reference, (NODES + 1, 1)), np.zeros((NODES, robot.nu)))
    solution = Fddp(problem).solve(standing)
    reached = np.array([pin.centerOfMass(model, data, x[: robot.nq]).copy() for x in solution.xs])
    return solution, np.linalg.norm(reached - circle, axis=1)


def main() -> None:
    """Solve the problem and print its figures."""
    solution, error = solve()
    print(solution.explain())
    print(f"centre of mass: {1e3 * error.mean():.2f} mm from the circle on average, at most {1e3 * error.max():.2f} mm")
    print(f"largest torque: {np.abs(solution.us).max():.2f} N.m")


if __name__ == "__main__":
    main()
