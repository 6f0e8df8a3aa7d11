"""A motion by Pinocchio, independent of the optimised expressions: kinematics, forces, simulation of free flights."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.ocp import Trajectory
from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray

_SAMPLES = 5
"""Number of spheres along a shank, knee and foot included."""


def com_positions(robot: Robot, xs: Array) -> Array:
    """Return (n, 3) the centre of mass at states (n, nx), world axes, m."""
    data = robot.create_data()
    return np.array([pin.centerOfMass(robot.model, data, x[: robot.nq]).copy() for x in xs]).reshape(-1, 3)


def com_speed(robot: Robot, x: Array) -> float:
    """Return the speed of the centre of mass in a state (nx,), m/s."""
    data = robot.create_data()
    pin.centerOfMass(robot.model, data, x[: robot.nq], x[robot.nq : robot.nq + robot.nv])
    return float(np.linalg.norm(data.vcom[0]))


def joint_limit_violation(robot: Robot, xs: Array) -> float:
    """Return the largest violation of position limits by joints of one coordinate, rad or m; 0 if there is none."""
    joints = xs[:, robot.joint_q]
    return float(np.maximum(robot.joint_lower - joints, joints - robot.joint_upper).max(initial=0.0))


def contact_positions(robot: Robot, xs: Array) -> Array:
    """Return (n, nc, 3) the origins of the contact frames at states (n, nx), world axes, m."""
    data, found = robot.create_data(), np.empty((len(xs), robot.nc, 3))
    for points, x in zip(found, xs, strict=True):
        pin.forwardKinematics(robot.model, data, x[: robot.nq])
        for point, index in zip(points, robot.contact_ids, strict=True):
            point[:] = pin.updateFramePlacement(robot.model, data, index).translation
    return found


def frame_placements(robot: Robot, frame: str, xs: Array) -> list[pin.SE3]:
    """Return the placement of a frame in the world at each of the states (n, nx).

    Raises:
        InputError: no such frame.
    """
    data, index, placements = robot.create_data(), robot.frame(frame), []
    for x in xs:
        pin.forwardKinematics(robot.model, data, x[: robot.nq])
        placements.append(pin.SE3(pin.updateFramePlacement(robot.model, data, index)))
    return placements


@dataclass(frozen=True, eq=False)
class Reactions:
    """The contact forces of a motion.

    Attributes:
        wrenches: (N, nc, size) on the robot at the origins of its contact frames, world axes, [force; moment] or force
            alone, N and N.m; over an impact their impulses. Zero where there is no contact.
        misfit: (N,) largest entry of the residual of the equations of motion, N or N.m, over an impact N.s.
    """

    wrenches: Array
    misfit: Array


def reactions(robot: Robot, trajectory: Trajectory, durations: Array, flags: BoolArray, size: int = 3) -> Reactions:
    """Return the forces of a trajectory.

    They follow from the change of velocity, ``J^T f = rnea(q, v, dv / h) - [0; u]`` or at an impact ``J^T f = M dv``,
    in least squares: there are more equations than forces, so that the residual shows whether the motion satisfies
    them.

    Args:
        robot: with contact frames.
        trajectory: semi-implicit Euler's: the velocity changes by ``h a``.
        durations: (N,) s; 0 for an impact.
        flags: (N, nc) which contacts are on the ground; at an impact, after it.
        size: 3 for points, which transmit a force, 6 for surfaces, which transmit a moment too.
    """
    model, data, nq = robot.model, robot.create_data(), robot.nq
    wrenches, misfit = np.zeros((len(durations), robot.nc, size)), np.zeros(len(durations))
    for k, (h, x, after) in enumerate(zip(durations, trajectory.xs, trajectory.xs[1:], strict=False)):
        q, v, dv = x[:nq], x[nq : nq + robot.nv], (after - x)[nq : nq + robot.nv]
        if h > 0.0:
            needed = np.array(pin.rnea(model, data, q, v, dv / h))
            needed[robot.joint_v] -= trajectory.us[k]
        else:
            still = np.zeros(robot.nv)
            needed = pin.rnea(model, data, q, still, dv) - pin.rnea(model, data, q, still, still)
        rows = _jacobian(robot, data, q, flags[k], size)
        if len(rows):
            found = np.linalg.lstsq(rows.T, needed, rcond=None)[0]
            wrenches[k, flags[k]] = found.reshape(-1, size)
            needed = needed - rows.T @ found
        misfit[k] = np.abs(needed).max()
    return Reactions(wrenches, misfit)


def carry(robot: Robot, q: Array, flags: BoolArray, size: int = 3) -> tuple[Array, Array]:
    """Return the contacts' wrenches (nc, size) and the efforts (nu,), N.m, that balance a posture at rest.

    The wrenches of least norm that balance gravity on the free base in least squares, and the efforts that then
    remain. Zero efforts if there is no contact.

    Args:
        robot: with free base and contact frames.
        q: (nq,) configuration.
        flags: (nc,) which contacts are on the ground.
        size: 3 or 6; see :func:`reactions`.
    """
    wrenches = np.zeros((robot.nc, size))
    if not flags.any():
        return wrenches, np.zeros(robot.nu)
    data, base = robot.create_data(), slice(0, robot.joint_v.start)
    gravity = pin.computeGeneralizedGravity(robot.model, data, q)
    rows = _jacobian(robot, data, q, flags, size)
    found = np.linalg.lstsq(rows[:, base].T, gravity[base], rcond=None)[0]
    wrenches[flags] = found.reshape(-1, size)
    return wrenches, (gravity - rows.T @ found)[robot.joint_v]


def friction_use(forces: Array, friction: float) -> Array:
    """Return (n,) the tangential parts of forces (n, 3), world axes, over the friction limits.

    Infinite where a normal force is not positive.
    """
    tangential, allowed = np.linalg.norm(forces[:, :2], axis=1), friction * forces[:, 2]
    return np.where(allowed > 0.0, tangential / np.maximum(allowed, 1e-12), np.inf)


def _jacobian(robot: Robot, data: pin.Data, q: Array, flags: BoolArray, size: int) -> Array:
    """Return (size * contacts, nv) rows of the contacts on the ground, world axes at their origins."""
    model = robot.model
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    down = [frame for frame, on in zip(robot.contact_ids, flags, strict=True) if on]
    rows = [pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:size] for frame in down]
    return np.vstack(rows) if rows else np.zeros((0, robot.nv))


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
    model, data, radius = robot.model, robot.create_data(), robot.foot_points.radius
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
