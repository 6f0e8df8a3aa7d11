"""Solo12 in free flight moves its legs and is pulled at one foot: only gravity and the pull change its momentum.

Chapter 4.8.2: ``h' = A_G v' + dA_G/dt v`` is the sum of the external wrenches; it does not depend on joint torques.
"""

from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np
import pinocchio as pin
from scipy.integrate import simpson

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Path, Row, Shape, largest
from lgmpc.lie import se3
from lgmpc.mechanics.euler_poincare import runge_kutta4
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.typing import Array

_STEP, _STEPS = 5e-4, 1200
_PULL = (400, 520)
"""First and last step of the pull."""
_FORCE = np.array([1.5, 3.0, 4.0])  # N, world axes
_FOOT = "FL_FOOT"
_THROW = np.array([0.2, 0.0, 2.6])  # m/s
_COLORS = (0x34414F, 0xE69F00, 0x4C78A8)


@dataclass(frozen=True)
class _Flight:
    """Configurations (n, nq) over times (n,), pulled foot, centre of mass (n, 3) and centroidal momentum (n, 6)."""

    times: Array
    qs: Array
    feet: Array
    coms: Array
    momenta: Array


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    robot = load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad=(-3.2, 3.2),
        )
    )
    flight = _fly(robot)
    momenta, coms = flight.momenta, flight.coms
    pulled = slice(_PULL[0], _PULL[1] + 1)
    lasts = (_PULL[1] - _PULL[0]) * _STEP
    total = _STEP * _STEPS
    weight = robot.mass * robot.gravity

    # In closed form: impulses, and the parabola with the pull's contribution from its middle to the end.
    linear = momenta[0, :3] + weight * total + _FORCE * lasts
    since = total - 0.5 * (_PULL[0] + _PULL[1]) * _STEP
    com = coms[0] + momenta[0, :3] / robot.mass * total + 0.5 * robot.gravity * total**2
    com += _FORCE * lasts / robot.mass * since
    # The pull's moment about the centre of mass depends on where the foot is: a quadrature.
    turned = simpson(np.cross(flight.feet[pulled] - coms[pulled], _FORCE), dx=_STEP, axis=0)

    free = momenta[: _PULL[0] + 1, 3:]
    rows = [
        Row("angular momentum before the pull", 0.0, largest(free - free[0]), 1e-9, "N.m.s"),
        *[
            Row(f"linear momentum at the end, {axis}", float(linear[i]), float(momenta[-1, i]), 1e-9, "N.s")
            for i, axis in enumerate("xyz")
        ],
        *[
            Row(f"angular momentum at the end, {axis}", float(turned[i]), float(momenta[-1, 3 + i]), 1e-8, "N.m.s")
            for i, axis in enumerate("xyz")
        ],
        Row("distance of the centre of mass from its parabola", 0.0, float(np.linalg.norm(coms[-1] - com)), 1e-9, "m"),
    ]
    t = flight.times
    predicted = momenta[0, :3] + weight * t[:, None]
    predicted = predicted + _FORCE * np.clip(t - _PULL[0] * _STEP, 0.0, lasts)[:, None]
    trunk = np.array([pin.rpy.matrixToRpy(pin.XYZQUATToSE3(q[:7]).rotation) for q in flight.qs])
    panels = (
        Panel.over_time(
            "Linear momentum",
            "N.s",
            *Curve.each("xyz", t, momenta),
            *Curve.each(("", "", ""), t, predicted, dashed=True),
        ),
        Panel.over_time("Angular momentum about the centre of mass", "N.m.s", *Curve.each("xyz", t, momenta[:, 3:])),
        Panel.over_time("Rotation of the trunk", "deg", *Curve.each(("roll", "pitch", "yaw"), t, np.degrees(trunk))),
    )
    shown = slice(None, None, 20)
    return Outcome(
        tuple(rows),
        panels,
        t[shown],
        tuple(_bodies(robot, flight.qs[shown])),
        (Path("centre of mass", coms[shown], 0xD55E00),),
        (
            "The legs move with torques up to a few N.m, which rotate the trunk but do not change the momentum.",
            f"A foot is pulled with {np.linalg.norm(_FORCE):.1f} N at {_PULL[0] * _STEP:g} s, for {lasts:g} s.",
        ),
    )


def _fly(robot: Robot) -> _Flight:
    """Integrate with the Runge-Kutta-Munthe-Kaas method of order 4, Pinocchio's accelerations, and log."""
    model, data = robot.model, robot.create_data()
    foot = robot.frame(_FOOT)
    q, v = np.array(robot.q_reference), np.zeros(robot.nv)
    q[2] += 0.3
    v[:3] = _THROW
    rest = q[7:].copy()
    phases = np.repeat([0.0, np.pi, 0.5 * np.pi, 1.5 * np.pi], 3)
    swing = np.tile([0.25, 0.5, 0.8], 4)

    def acceleration(time: float, q: Array, v: Array, pull: Array) -> Array:
        desired = rest + swing * (np.sin(14.0 * time + phases) - np.sin(phases))
        load = np.concatenate([np.zeros(6), 3.0 * (desired - q[7:]) - 0.08 * v[6:]])
        jacobian = pin.computeFrameJacobian(model, data, q, foot, pin.LOCAL_WORLD_ALIGNED)[:3]
        return np.array(pin.aba(model, data, q, v, load + jacobian.T @ pull))

    def rates(time: float, q: Array, pull: Array, elapsed: float, y: Array) -> Array:
        """Return the rates of the tangent coordinates from q, and of the velocity."""
        u, velocity = np.split(y, 2)
        moved = pin.integrate(model, q, u)
        return np.concatenate((_inverse_differential(u, velocity), acceleration(time + elapsed, moved, velocity, pull)))

    qs, vs = [q], [v]
    for k in range(_STEPS):
        slope = partial(rates, k * _STEP, qs[-1], _FORCE * (_PULL[0] <= k < _PULL[1]))
        u, v = np.split(runge_kutta4(slope, np.concatenate((np.zeros(robot.nv), vs[-1])), _STEP), 2)
        qs.append(pin.integrate(model, qs[-1], u))
        vs.append(v)
    feet = []
    for q in qs:
        pin.framesForwardKinematics(model, data, q)
        feet.append(data.oMf[foot].translation.copy())
    times: Array = _STEP * np.arange(_STEPS + 1, dtype=np.float64)
    symbolic, at, moving = SymbolicModel(model), ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv)
    measure = ca.Function("measure", [at, moving], [symbolic.com(at), symbolic.momentum(at, moving)])
    coms, momenta = (found.full().T for found in measure.map(len(qs))(np.array(qs).T, np.array(vs).T))
    return _Flight(times, np.array(qs), np.array(feet), coms, momenta)


def _inverse_differential(u: Array, v: Array) -> Array:
    """Return the rate of the tangent coordinates u of the step whose body velocity is v (Munthe-Kaas 1999)."""
    found = v.copy()
    found[:6] = se3.right_jacobian_inverse.unchecked(u[:6]) @ v[:6]
    return found


def _bodies(robot: Robot, qs: Array) -> list[Body]:
    """Return the trunk as a box, a ball at every joint and a rod to the next joint or the foot."""
    model, data = robot.model, robot.create_data()
    poses = []
    for q in qs:
        pin.forwardKinematics(model, data, q)
        poses.append([placement.homogeneous for placement in data.oMi])
    placed = np.array(poses)
    ends = {model.parents[j]: model.jointPlacements[j].translation for j in range(2, model.njoints)}
    ends |= {model.frames[i].parentJoint: model.frames[i].placement.translation for i in robot.contact_ids}
    bodies = [
        Body("trunk", (Shape("box", (0.42, 0.2, 0.06), color=_COLORS[0]),), placed[:, 1, :3, 3], placed[:, 1, :3, :3])
    ]
    for j in range(2, model.njoints):
        color = _COLORS[1 + j % 2]
        end = np.asarray(ends[j])
        length = float(np.linalg.norm(end))
        along = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length).matrix()
        middle = (float(0.5 * end[0]), float(0.5 * end[1]), float(0.5 * end[2]))
        shapes = (
            Shape("sphere", (0.018, 0.018, 0.018), color=color),
            Shape("cylinder", (0.011, 0.011, length), middle, color, rotation=along),
        )
        bodies.append(Body(f"legs/{model.names[j]}", shapes, placed[:, j, :3, 3], placed[:, j, :3, :3]))
    return bodies
