"""The reference of predictive models that have neither base nor joints."""

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.lie.symbolic import quaternion, so3
from lgmpc.locomotion.horizon import MotionReference
from lgmpc.mpc.interface import MeasuredState
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array


class CentroidalReference:
    """Writes centre of mass and momenta over the horizon, in one compiled call.

    A base turned from its reference by the angle ``theta`` (body axes) is turned back with the angular momentum
    ``I rate exp(-rate t) theta``, besides that of the reference's own angular velocity.

    Args:
        target: (N+1, 9) [centre of mass; linear momentum; angular momentum], where the reference is written.
        mass: of the robot, kg.
        uprighting_rate: 1/s.
        grid: intervals of the horizon.

    Raises:
        CompileError: the compiler failed.
    """

    def __init__(self, target: Array, mass: float, uprighting_rate: float, grid: TimeGrid) -> None:
        nodes = len(target)
        self._motion = tuple(np.zeros((3, nodes, 3)))
        self._attitude, self._rotation, self._inertia = np.zeros(4), np.zeros((3, 3)), np.zeros((3, 3))
        fading = uprighting_rate * np.exp(-TimeGrid(uprighting_rate * grid.period, grid.count).elapsed)
        com, com_velocity, angular_velocity = self._motion
        turn, rotation = np.zeros(3), self._rotation.reshape(-1)
        self._turn = StageKernel.of(_turn).bind(1, attitude=self._attitude, rotation=rotation, turn=turn)
        self._run = StageKernel.of(_centroidal_reference).bind(
            nodes, com=com, com_velocity=com_velocity, angular_velocity=angular_velocity, fading=fading[:, None],
            mass=np.array([mass]), turn=turn, rotation=rotation, inertia=self._inertia.reshape(-1), x_reference=target,
        )  # fmt: skip

    def write(self, state: MeasuredState, reference: MotionReference) -> None:
        """Write the reference at the measured state.

        Raises:
            ValueError: an array of the wrong shape.
        """
        given = (reference.com, reference.com_velocity, reference.angular_velocity)
        for mine, theirs in zip(self._motion, given, strict=True):
            if theirs.shape != mine.shape:
                raise ValueError(f"shape {theirs.shape} of the reference instead of {mine.shape}")
            mine[...] = theirs
        self._attitude[:] = reference.q[0, 3:7]
        self._rotation[...] = state.rotation
        self._inertia[...] = state.inertia
        self._turn()
        self._run()


def _turn() -> ca.Function:
    """Return the rotation vector from a measured to a desired orientation; matrices are stored row by row."""
    attitude, stored = ca.SX.sym("attitude", 4), ca.SX.sym("rotation", 9)
    rotation = ca.reshape(stored, 3, 3).T
    turn = so3.log(ca.mtimes(rotation.T, quaternion.to_matrix(attitude)))
    return ca.Function("turn_to_reference", [attitude, stored], [turn], ["attitude", "rotation"], ["turn"])


def _centroidal_reference() -> ca.Function:
    """Return the reference at one node; matrices are stored row by row."""
    sizes = {"com": 3, "com_velocity": 3, "angular_velocity": 3, "fading": 1, "mass": 1, "turn": 3}
    s = {name: ca.SX.sym(name, size) for name, size in {**sizes, "rotation": 9, "inertia": 9}.items()}
    rotation, inertia = (ca.reshape(s[name], 3, 3).T for name in ("rotation", "inertia"))
    turning = s["fading"] * s["turn"] + ca.mtimes(rotation.T, s["angular_velocity"])
    x = ca.vertcat(s["com"], s["mass"] * s["com_velocity"], ca.mtimes(inertia, turning))
    return ca.Function("centroidal_reference", list(s.values()), [x], list(s), ["x_reference"])
