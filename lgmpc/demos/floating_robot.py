"""A free robot of three bodies over 1000 s, for the demonstration of the integrators."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.actions import FreeForwardDynamics, Integrator, MultibodyAction
from lgmpc.compile import StageKernel
from lgmpc.demos.outcome import Body, Shape
from lgmpc.lie import so3
from lgmpc.typing import Array

__all__ = ["RobotRun", "robot_scene", "run_robot"]

_TORSO, _ARM, _REACH = np.array([0.12, 0.3, 0.4]), 0.3, 0.3


@dataclass(frozen=True)
class RobotRun:
    """The robot's motion, by one method.

    Attributes:
        times: (n,) s.
        states: (n, nx).
        energy: (n,) relative change of the energy.
        momentum: (n,) norm of the change of [linear; angular] momentum about the world's origin, over the initial norm.
    """

    times: Array
    states: Array
    energy: Array
    momentum: Array


def run_robot(integrator: Integrator, h: float, duration: float, every: int) -> RobotRun:
    """Simulate a torso with two swinging arms in free flight, in one compiled call.

    Args:
        integrator: the method.
        h: step, s.
        duration: s.
        every: number of steps between two stored states.
    """
    model = _model()
    action = MultibodyAction("robot", FreeForwardDynamics(model, np.zeros((model.nv, 0))), integrator=integrator)
    x, p = ca.SX.sym("x", action.state.nx), ca.SX.sym("p", action.parameters.size)
    name = f"robot_{type(integrator).__name__}"
    step = ca.Function(name, [x, p], [action.step(x, ca.SX(0, 1), p)], ["x", "p"], ["x_next"])
    values = action.parameters.default.copy()
    values[action.parameters["duration"]] = h
    steps = round(duration / h)
    states = np.zeros((steps + 1, action.state.nx))
    states[0] = pin.neutral(model).tolist() + [0.1, -0.05, 0.02, 0.3, 0.1, 0.4, 0.5, -0.3]
    states[0, 7:9] = 0.3, -0.2
    StageKernel(step).bind(steps, x=states[:-1], p=values, x_next=states[1:])()
    kept = states[::every].copy()
    energy, momentum = _measure(model, kept)
    change = np.linalg.norm(momentum - momentum[0], axis=1) / np.linalg.norm(momentum[0])
    return RobotRun(np.arange(len(kept), dtype=np.float64) * (h * every), kept, energy / energy[0] - 1.0, change)


def robot_scene(run: RobotRun) -> tuple[Body, ...]:
    """Return the bodies of the scene: torso and arms at the run's states."""
    model = _model()
    data, placements = model.createData(), []
    for q in run.states[:, : model.nq]:
        pin.forwardKinematics(model, data, q)
        placements.append([(data.oMi[i].translation.copy(), data.oMi[i].rotation.copy()) for i in (1, 2, 3)])
    length = 2.0 * _ARM
    arm = Shape("box", (0.06, 0.06, length), (0.0, 0.0, -_ARM / 2.0), 0xE45756)
    width, depth, height = _TORSO.tolist()
    along_y = so3.exp(np.array([np.pi / 2.0, 0.0, 0.0]))
    shoulders = Shape("cylinder", (0.02, 0.02, 2.0 * _REACH), color=0x34414F, rotation=along_y)
    torso = Shape("box", (width, depth, height))
    shapes = {"torso": (torso, shoulders), "arms/left": (arm,), "arms/right": (arm,)}
    return tuple(
        Body(name, parts, np.array([p[i][0] for p in placements]), np.array([p[i][1] for p in placements]))
        for i, (name, parts) in enumerate(shapes.items())
    )


def _model() -> pin.Model:
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "torso")
    model.appendBodyToJoint(root, pin.Inertia.FromBox(2.0, *_TORSO.tolist()), pin.SE3.Identity())
    for name, side in (("left", 1.0), ("right", -1.0)):
        shoulder = pin.SE3(np.eye(3), np.array([0.0, _REACH * side, 0.0]))
        joint = model.addJoint(root, pin.JointModelRY(), shoulder, name)
        arm = pin.Inertia.FromBox(0.5, 0.06, 0.06, 2.0 * _ARM)
        model.appendBodyToJoint(joint, arm, pin.SE3(np.eye(3), np.array([0.0, 0.0, -_ARM / 2.0])))
    return model


def _measure(model: pin.Model, states: Array) -> tuple[Array, Array]:
    """Return (n,) energies and (n, 6) momenta about the world's origin, by Pinocchio."""
    data, energies, momenta = model.createData(), [], []
    for state in states:
        q, v = state[: model.nq], state[model.nq :]
        inside = pin.computeCentroidalMomentum(model, data, q, v)
        momenta.append(np.concatenate((inside.linear, inside.angular + np.cross(data.com[0], inside.linear))))
        energies.append(pin.computeKineticEnergy(model, data, q, v))
    return np.array(energies), np.array(momenta)
