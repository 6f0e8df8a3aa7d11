"""Estimate of the joints' Coulomb friction, from the torques of legs in the air."""

from typing import Annotated, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lgmpc.compile import StageKernel
from lgmpc.control.interface import RobotState
from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of, number
from lgmpc.robot import Robot
from lgmpc.settings import Fraction, Positive, Settings, key
from lgmpc.typing import Array, BoolArray, instance

_MOVING = 1.0  # rad/s: from here on the smoothed sign of a speed is one, and noise does not change it
_FAST = 5.0  # rad/s: slower motion counts less, because friction needs some way after a reversal to develop
_CLEAR_S = 0.01  # s from the last contact of a foot, or command to carry, until its leg is a free one


class JointFrictionSettings(Settings):
    """Estimation of the friction of the joints."""

    memory_s: Positive = key(1.0, "Time over which a joint's torques are compared, s of its motion in the air.")
    excitation_s: Annotated[Positive, Field(le=10.0)] = key(
        0.1,
        "Fast motion of a joint in the air that an estimate requires, in each direction, s; motion in one"
        " direction cannot distinguish friction from an error of the model.",
    )
    rise_s: Positive = key(0.05, "Time constant with which the compensated friction follows the estimate, s.")
    largest_share: Fraction = key(0.1, "Upper bound of a joint's estimated friction, as a share of its torque limit.")


class JointFrictionEstimator:
    """Coulomb friction of each joint, as the part of its torque that follows the sign of its speed.

    While a leg is in the air, the equations of motion of its joints hold no unknown force: the torque that acted over
    a tick, less ``M a + h`` at the measured state and the change of the measured velocity, is ``f sign(v) + b``, with
    the friction f and the mean b of all that is wrong with the model. Both follow in least squares over the joint's
    recent motion, with fading memory, and f only if it moved both ways: ``f = (n S_sr - S_s S_r) / (n^2 - S_s^2)`` with
    the sums of signs s and residuals r, whose denominator is the excitation.

    A robot that stands excites nothing, not even while it is pushed: twelve forces of the feet and an unknown wrench
    leave no equation of motion over. The first steps are enough, and what was learnt stays.

    Args:
        robot: the controller's model; its own joint friction is where the estimate begins.
        period: time between two ticks, s.
        settings: see :class:`JointFrictionSettings`.
        delay: from a measurement until the command that it leads to acts, s.

    Attributes:
        friction: (nu,) to compensate, N.m; a live view.
        estimate: (nu,) least-squares value at the last tick of each joint, bounded, N.m.
        excited: (nu,) whether each joint has moved enough, at one time, for an estimate; the others are assumed to have
            the same share of their torque limit.

    Raises:
        InputError: a robot without feet on legs of their own, or a period that is not positive.
    """

    def __init__(
        self, robot: Robot, period: float, settings: JointFrictionSettings | None = None, delay: float = 0.0
    ) -> None:
        self.settings = s = JointFrictionSettings() if settings is None else settings
        instance("robot", robot, Robot)
        instance("settings", s, JointFrictionSettings)
        number("delay", delay, "a number of seconds that is not negative", 0.0)
        self._period = duration_of("period", period)
        self._legs = _legs(robot)
        self._keep = np.exp(-period / s.memory_s)
        self._follow = -np.expm1(-period / s.rise_s)
        self._least = s.excitation_s / period
        self._highest = s.largest_share * robot.effort_limit
        self._effort = robot.effort_limit.copy()
        self.friction = np.minimum(robot.joint_friction, self._highest)
        self.estimate = self.friction.copy()
        self.excited = np.zeros(robot.nu, dtype=np.bool_)
        kernel = StageKernel.of(_free_torques, robot)
        memory = {name: np.zeros(size) for name, size in kernel.input_sizes.items()}
        self._q, self._v, self._acceleration = memory["q"], memory["v"], memory["acceleration"]
        self._free = np.zeros(robot.nu)
        self._run = kernel.bind(1, **memory, torques=self._free)
        self._commands = np.full((round(delay / period) + 1, robot.nu), np.nan)  # the newest first
        self._clear = np.zeros(robot.nc)  # s that each leg has been in the air
        self._sums = np.zeros((4, robot.nu))  # of ones, signs, residuals, signs times residuals
        self._memory: tuple[NDArray[Any], ...] = (
            self.friction,
            self.estimate,
            self.excited,
            self._clear,
            self._sums,
            self._q,
            self._v,
        )
        self.reset()

    def reset(self) -> None:
        """Forget what was measured, but not the friction."""
        self._clear[:] = self._sums[:] = 0.0
        self._commands[:] = np.nan

    def state(self) -> tuple[NDArray[Any], ...]:
        """Return a copy of the state: estimates, sums of the regression, last measurement, and last commands."""
        return tuple(each.copy() for each in (*self._memory, self._commands))

    def set_state(self, state: tuple[NDArray[Any], ...]) -> None:
        """Continue from another estimator's state; commands further back than its memory are unknown."""
        for mine, theirs in zip(self._memory, state[:-1], strict=True):
            mine[:] = theirs
        self._commands[:] = np.nan
        count = min(len(state[-1]), len(self._commands))
        self._commands[:count] = state[-1][:count]

    def update(self, state: RobotState, stance: BoolArray, missed: int = 0) -> Array:
        """Take the measured state of this tick and return :attr:`friction`; :meth:`expect` follows.

        Args:
            state: measured.
            stance: (nc,) feet that are to carry.
            missed: ticks without update before this one: the last command went on, nothing was measured.
        """
        for _ in range(min(missed, len(self._commands))):
            self._commands[1:] = self._commands[:-1]
        flying = ~stance if state.contacts is None else ~(stance | state.contacts)
        self._clear[:] = np.where(flying, self._clear + self._period, 0.0)
        free = np.asarray(self._legs[self._clear > _CLEAR_S].any(axis=0))
        if bool(free.any()) and not missed:
            np.subtract(state.v, self._v, out=self._acceleration)
            self._acceleration /= self._period
            self._learn(free)
        self._q[:], self._v[:] = state.q, state.v
        return self.friction

    def expect(self, torques: Array) -> None:
        """Store the torques (nu,) of the command that was just computed, N.m."""
        self._commands[1:] = self._commands[:-1]
        self._commands[0] = torques

    def _learn(self, free: BoolArray) -> None:
        rates = self._v[-len(self.friction) :]
        self._run()  # at the state before, from which the tick's mean acceleration began
        residual = self._commands[-1] - self._free
        used = free & (np.abs(rates) > _MOVING) & np.isfinite(residual)
        if not used.any():
            return
        sign, sums = np.sign(rates[used]), self._sums[:, used]
        weight = np.minimum(np.square(rates[used] / _FAST), 1.0)
        sums *= self._keep
        sums += weight * np.array([np.ones_like(sign), sign, residual[used], sign * residual[used]])
        self._sums[:, used] = sums
        count, signs, residuals, products = sums
        # Twice the harmonic mean of the times in the two directions.
        determinant = count**2 - signs**2
        excited = determinant > 2.0 * self._least * count
        slope = (count * products - signs * residuals) / np.maximum(determinant, 1.0)
        self.excited[used] |= excited
        joints = np.flatnonzero(used)[excited]
        self.estimate[joints] = np.clip(slope[excited], 0.0, self._highest[joints])
        self.friction[joints] += self._follow * (self.estimate[joints] - self.friction[joints])
        if self.excited.any() and not self.excited.all():
            self._take_after_the_others()

    def _take_after_the_others(self) -> None:
        """Joints that hardly move, as hips do straight ahead, have drives like those of the others."""
        share = float((self.friction[self.excited] / self._effort[self.excited]).mean())
        still = ~self.excited
        self.friction[still] = share * self._effort[still]


def _legs(robot: Robot) -> BoolArray:
    """Return (nc, nu) which joints carry each contact point; a joint of several legs belongs to none."""
    model = robot.model
    if not robot.floating_base or robot.nq - 7 != robot.nu or robot.nc == 0:
        raise InputError("robot", robot.name, "a floating base, joints of one coordinate each, and contact frames")
    legs = np.zeros((robot.nf, robot.nu), dtype=np.bool_)
    for foot, frame in enumerate(robot.foot_ids):
        for joint in model.supports[model.frames[frame].parentJoint]:
            if joint > 1:
                legs[foot, model.joints[joint].idx_v - 6] = True
    legs[:, legs.sum(axis=0) > 1] = False
    return legs[robot.foot_points.of]


def _free_torques(robot: Robot) -> ca.Function:
    """Return the joint torques of a motion without contact forces."""
    q, v, a = (ca.SX.sym(name, size) for name, size in (("q", robot.nq), ("v", robot.nv), ("a", robot.nv)))
    torques = ca.cse(robot.symbolic.rnea(q, v, a)[6:])
    return ca.Function("free_torques", [q, v, a], [torques], ["q", "v", "acceleration"], ["torques"])
