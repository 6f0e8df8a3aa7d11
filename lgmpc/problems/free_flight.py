"""The motion of a robot in free flight: independent simulation of a plan, and distance of its shanks from its trunk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.ocp import Trajectory
from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["Flown", "refly", "spins", "trunk_clearance", "trunk_spins"]

_SAMPLES = 5
"""Number of spheres along a shank, knee and foot included."""


@dataclass(frozen=True, eq=False)
class Flown:
    """The result of the simulation of a plan.

    Attributes:
        x: (nx,) last state.
        spin: largest change of the angular momentum about the centre of mass, N.m.s.
        path_error: largest distance of a joint from its planned path, rad.
    """

    x: Array
    spin: float
    path_error: float


def refly(
    robot: Robot, plan: Trajectory, times: Array, stiffness: float, damping: float, step: float = 2.5e-4
) -> Flown:
    """Simulate a plan: its torques and, for each joint, a PD controller on the planned path.

    The methods are independent of the solvers': Pinocchio's articulated-body algorithm and a Runge-Kutta method on the
    configuration's group, in steps much finer than the plan's. The torques, constant over a step and clipped to the
    limits, are internal: they do not change the angular momentum, whatever the errors of the plan's integrator.

    Args:
        robot: robot with a free base and joints of one angle each.
        plan: states and torques at the nodes; the joints' path between them is the cubic of positions and rates.
        times: (N+1,) times of the nodes, s.
        stiffness: stiffness of the joints' controllers, N.m/rad.
        damping: damping of the joints' controllers, N.m.s/rad.
        step: largest integration step, s.
    """
    from scipy.interpolate import CubicHermiteSpline  # here, because it takes longer to import than all problems

    model, data, nq = robot.model, robot.create_data(), robot.nq
    angles, rates = plan.xs[:, robot.joint_q], plan.xs[:, nq:][:, robot.joint_v]
    path = CubicHermiteSpline(times, angles, rates)
    x, start = plan.xs[0], spins(robot, plan.xs[:1])[0]
    spin = error = 0.0
    for k, span in enumerate(np.diff(times)):
        count = int(np.ceil(span / step - 1e-9))
        grid = times[k] + span / count * np.arange(count + 1)
        desired, moving = path(grid), path(grid, 1)
        for i in range(count):
            off, lag = desired[i] - x[robot.joint_q], moving[i] - x[nq:][robot.joint_v]
            effort = np.clip(plan.us[k] + stiffness * off + damping * lag, -robot.effort_limit, robot.effort_limit)
            x = _runge_kutta(model, data, x, np.concatenate([np.zeros(6), effort]), span / count)
            error = max(error, float(np.abs(desired[i + 1] - x[robot.joint_q]).max()))
        spin = max(spin, float(np.linalg.norm(spins(robot, x[None])[0] - start)))
    return Flown(x, spin, error)


def spins(robot: Robot, xs: Array) -> Array:
    """Return (n, 3) the angular momentum about the centre of mass at states (n, nx), world axes, N.m.s."""
    data, nq = robot.create_data(), robot.nq
    found = [pin.computeCentroidalMomentum(robot.model, data, x[:nq], x[nq:]).angular.copy() for x in xs]
    return np.array(found).reshape(-1, 3)


def trunk_spins(robot: Robot, xs: Array) -> Array:
    """Return (n, 3) the angular momentum of the base's link about its own centre of mass, base axes, N.m.s."""
    inertia = robot.model.inertias[1].inertia
    return np.array([inertia @ x[robot.nq + 3 : robot.nq + 6] for x in xs])


def trunk_clearance(robot: Robot, xs: Array, trunk_half_size: Array) -> float:
    """Return the smallest distance of a shank from the trunk, m.

    A shank is a row of spheres of the feet's radius, from the last joint before a contact frame to that frame; the
    trunk is a box about the base's origin.

    Args:
        robot: robot with contact frames.
        xs: (n, nx) states.
        trunk_half_size: (3,) half sizes of the box, m.
    """
    model, data, radius = robot.model, robot.create_data(), robot.contact_radius
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    least = np.inf
    for x in xs:
        pin.framesForwardKinematics(model, data, x[: robot.nq])
        shanks = []
        for index in robot.contact_ids:
            knee, foot = data.oMi[model.frames[index].parentJoint].translation, data.oMf[index].translation
            shanks.append((1.0 - share) * knee + share * foot)
        base = data.oMi[1]
        local = (np.concatenate(shanks) - base.translation) @ base.rotation
        beside = np.linalg.norm(np.maximum(np.abs(local) - trunk_half_size, 0.0), axis=1)
        least = min(least, float(beside.min()) - radius)
    return least


def _runge_kutta(model: pin.Model, data: pin.Data, x: Array, effort: Array, h: float) -> Array:
    """Return the state after a classical step, commutator-free on the group (Celledoni, Marthinsen, Owren, 2003)."""
    q, v = x[: model.nq], x[model.nq :]
    a = pin.aba(model, data, q, v, effort).copy()
    v2, q2 = v + h / 2 * a, pin.integrate(model, q, h / 2 * v)
    a2 = pin.aba(model, data, q2, v2, effort).copy()
    v3, q3 = v + h / 2 * a2, pin.integrate(model, q, h / 2 * v2)
    a3 = pin.aba(model, data, q3, v3, effort).copy()
    v4, q4 = v + h * a3, pin.integrate(model, q2, h * (v3 - v / 2))
    a4 = pin.aba(model, data, q4, v4, effort)
    halfway = pin.integrate(model, q, h / 12 * (3 * v + 2 * v2 + 2 * v3 - v4))
    q_next = pin.integrate(model, halfway, h / 12 * (-v + 2 * v2 + 2 * v3 + 3 * v4))
    return np.concatenate([q_next, v + h / 6 * (a + 2 * a2 + 2 * a3 + a4)])
