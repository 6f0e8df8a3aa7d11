"""Detection of motors that give less torque than they are commanded, from how the robot moves."""

import math
from typing import Annotated, Any

import casadi as ca
import numpy as np
from pydantic import Field

from lgmpc.compile import StageKernel
from lgmpc.control.interface import RobotState
from lgmpc.errors import InputError
from lgmpc.robot import Robot, leg_joints
from lgmpc.robot.contact_points import ContactPoints
from lgmpc.robot.feet import UP
from lgmpc.settings import Positive, Settings, key
from lgmpc.typing import GRAVITY, Array

_SMOOTHED_S, _REMEMBERED_S, _STEADY_S = 0.01, 0.025, 1.0
_EXPLAINED = 0.95
"""Least share of the residual, in squares, that a lost torque explains."""
_LOST = 0.3, 1.15
"""Range of the lost share of the torque: less may be an error of the model, and more cannot be lost."""
_WEIGHT_SHARE = 0.08
"""Least residual, as a share of the weight."""
_DEAD_SHARE = 0.25
"""Share of its torque below which a motor counts as dead."""
_LONGEST_GAP_S = 0.01
"""Time without an update after which what was measured before counts no more."""
_STRETCHED = 0.006
"""Determinant of a leg's Jacobian, over the cube of the height, below which its inverse is damped: standing 0.3."""


class JointFaultSettings(Settings):
    """Detection of motors that have lost a part of their torque."""

    confirm_s: Annotated[Positive, Field(le=1.0)] = key(
        0.03, "Time for which a lost torque has to explain the motion until it is acted on, s."
    )


class JointFaultMonitor:
    r"""Compares the motion of the trunk with that of the torques commanded, and finds the joint that explains why not.

    The equations of motion of a leg's three joints return the force at its foot, wherever that is, in the air too:
    ``f = J^-T (rnea_leg(q, v, a) - tau)``. With these forces the equations of the base leave over ``r``, which is zero
    for an exact model. If joint j gives only a share s of its torque, ``r = (1 - s) phi_j`` with
    ``phi_j = J_b^T J^-T e_j tau_j``: for each joint a wrench of its own, through the foot, that varies with its torque.
    The lost share follows in least squares over the last hundredths of a second, and is believed where it explains
    nearly all of what came new, is between none and all of the torque, and lasts. A push has another line of action,
    and a payload is there for long.

    Args:
        robot: the controller's model, with point feet on legs of three joints.
        period: time between two ticks, s.
        settings: see :class:`JointFaultSettings`.
        delay: from a measurement until the command that it leads to acts, s.

    Attributes:
        shares: (nu,) of its torque that each motor gives: 1 if sound, 0 if dead.

    Raises:
        InputError: a robot with other feet or legs.
    """

    def __init__(
        self, robot: Robot, period: float, settings: JointFaultSettings | None = None, delay: float = 0.0
    ) -> None:
        self.settings = JointFaultSettings() if settings is None else settings
        self.shares = np.ones(robot.nu)
        self._period = period
        self._commands = np.full((round(delay / period) + 1, robot.nu), np.nan)  # the newest first
        if legs_of_three(robot) is None:
            raise InputError("robot", robot.name, "a floating base, and point feet on legs of three joints each")
        kernel = StageKernel.of(_lost_shares, robot)
        self._memory = memory = {name: np.zeros(size) for name, size in kernel.input_sizes.items()}
        memory["keep"][:] = np.exp(-period / np.array([_STEADY_S, _SMOOTHED_S, _REMEMBERED_S]))
        self._next, self._lost, self._best = np.zeros_like(memory["state"]), np.zeros(robot.nu), np.zeros(2)
        self._run = kernel.bind(1, **memory, state_next=self._next, lost=self._lost, best=self._best)
        self.reset()

    def reset(self) -> None:
        """Forget what was measured, but not the faults."""
        self._commands[:] = math.nan
        self._suspect, self._since, self._time = -1, math.inf, -math.inf
        self._memory["state"][:] = 0.0

    def update(self, state: RobotState) -> int | None:
        """Take the measured state of this tick, in which only feet touch the ground; :meth:`expect` follows.

        Of ticks that were missed since the last one, the last command went on.

        Returns:
            The joint whose share changed; None if none did.
        """
        memory, commands = self._memory, self._commands
        elapsed = max(state.time - self._time, self._period)
        if elapsed > _LONGEST_GAP_S:
            self.reset()
        elif elapsed > 1.5 * self._period:
            for _ in range(min(round(elapsed / self._period) - 1, len(commands))):
                commands[1:] = commands[:-1]
        memory["torques"][:], memory["elapsed"][0], memory["v_next"][:] = commands[-1], elapsed, state.v
        self._run()
        memory["state"][:], memory["q"][:], memory["v"][:], self._time = self._next, state.q, state.v, state.time
        return self._judge(state.time)

    def expect(self, torques: Array) -> None:
        """Store the torques (nu,) of the command that was just computed, as the motors should give them, N.m."""
        self._commands[1:] = self._commands[:-1]
        self._commands[0] = torques

    def _judge(self, time: float) -> int | None:
        """Return the joint whose lost share has explained the motion for long enough."""
        explained, joint = self._best.tolist()
        suspect = int(joint) if explained > _EXPLAINED else -1
        if suspect != self._suspect or suspect < 0:
            self._suspect, self._since = suspect, time
            return None
        if time - self._since < self.settings.confirm_s:
            return None
        share = self.shares[suspect] * max(1.0 - float(self._lost[suspect]), 0.0)
        self.shares[suspect] = share if share >= _DEAD_SHARE else 0.0
        self._memory["state"][:], self._suspect = 0.0, -1
        return suspect


def legs_of_three(robot: Robot) -> list[list[int]] | None:
    """Return the joints of each leg, as indices of joints, of a robot whose point feet have legs of three joints."""
    model = robot.model
    if not robot.floating_base or robot.nq - 7 != robot.nu or not robot.nc or not robot.foot_points.single:
        return None
    legs = [[model.joints[joint].idx_v - 6 for joint in leg_joints(robot, frame)] for frame in robot.foot_ids]
    joints = [joint for leg in legs for joint in leg]
    return legs if len(set(joints)) == len(joints) and all(len(leg) == 3 for leg in legs) else None


def _lost_shares(robot: Robot) -> ca.Function:
    """One update. State: slow mean of the residual, both smoothed, and sums r phi, phi phi, r r with fading memory."""
    nu = robot.nu
    sizes = {"q": robot.nq, "v": robot.nv, "v_next": robot.nv, "elapsed": 1, "torques": nu}
    sizes |= {"state": 13 + 8 * nu, "keep": 3}
    given = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    q, v, torques = given["q"], given["v"], given["torques"]
    steady_keep, smooth_keep, keep = ca.vertsplit(given["keep"])
    legs, base = legs_of_three(robot), robot.nv - nu
    assert legs is not None
    height = float(robot.q_reference[2])
    least = _STRETCHED * height**3
    forces = robot.symbolic.rnea(q, v, (given["v_next"] - v) / given["elapsed"])
    contacts = ContactPoints(robot, q, v, ca.SX(np.tile(UP, robot.nc)))
    jacobian = contacts.jacobian()
    residual, unit = forces[:base], ca.SX(base, nu)
    for foot, joints in enumerate(legs):
        rows = slice(3 * foot, 3 * foot + 3)
        leg = ca.horzcat(*(jacobian[rows, base + joint] for joint in joints))
        a, b, c = leg[:, 0], leg[:, 1], leg[:, 2]
        cofactors = ca.horzcat(ca.cross(b, c), ca.cross(c, a), ca.cross(a, b))  # det J^-T
        determinant = ca.dot(a, cofactors[:, 0])
        on_base = ca.mtimes(jacobian[rows, :base].T, cofactors) * determinant / (determinant**2 + least**2)
        for k, joint in enumerate(joints):
            residual -= on_base[:, k] * (forces[base + joint] - torques[joint])
            unit[:, joint] = on_base[:, k]
    scale = ca.vertcat(np.ones(3), np.full(3, 1.0 / height))
    residual, lost = residual * scale, ca.mtimes(ca.diag(scale), unit) @ ca.diag(torques)
    steady, smooth, smooth_lost, products, squares, square = ca.vertsplit(
        given["state"], [0, 6, 12, 12 + 6 * nu, 12 + 7 * nu, 12 + 8 * nu, 13 + 8 * nu]
    )
    steady = steady_keep * steady + (1.0 - steady_keep) * residual
    smooth = smooth_keep * smooth + (1.0 - smooth_keep) * (residual - steady)
    smooth_lost = smooth_keep * smooth_lost + (1.0 - smooth_keep) * ca.vec(lost)
    columns = ca.reshape(smooth_lost, base, nu)
    products = keep * products + (1.0 - keep) * ca.mtimes(columns.T, smooth)
    squares = keep * squares + (1.0 - keep) * ca.sum1(columns**2).T
    square = keep * square + (1.0 - keep) * ca.sumsqr(smooth)
    share = products / ca.fmax(squares, 1e-9)
    explained = products**2 / ca.fmax(squares * square, 1e-9)
    least_square = (_WEIGHT_SHARE * GRAVITY * robot.mass) ** 2
    possible = ca.logic_and(ca.logic_and(share > _LOST[0], share < _LOST[1]), square > least_square)
    score = ca.if_else(possible, explained, 0.0)
    best, suspect = ca.SX(0.0), ca.SX(0.0)
    for j in range(nu):
        suspect = ca.if_else(score[j] > best, j, suspect)
        best = ca.fmax(best, score[j])
    known = ca.fabs(ca.sum1(residual)) < math.inf  # of the first tick no torque is
    state_next: Any = ca.vertcat(steady, smooth, smooth_lost, products, squares, square)
    state_next, best = ca.if_else(known, state_next, given["state"]), ca.if_else(known, best, 0.0)
    outputs = ca.cse([state_next, share, ca.vertcat(best, suspect)])
    return ca.Function("lost_torques", list(given.values()), outputs, list(given), ["state_next", "lost", "best"])
