"""Torques of legs in the air beyond those of their motion: of what pushes them, and of the joints' Coulomb friction."""

import math
from typing import Annotated, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lgmpc.compile import StageKernel
from lgmpc.control.interface import RobotState
from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of
from lgmpc.robot import Robot, leg_joints
from lgmpc.settings import Fraction, Positive, Settings, key
from lgmpc.typing import Array, BoolArray, instance

_MOVING = 1.0  # rad/s: from here on the smoothed sign of a speed is one, and noise does not change it
_FAST = 5.0  # rad/s: slower motion counts less, because friction needs some way after a reversal to develop
_CLEAR_S = 0.01  # s from the last contact of a foot, or command to carry, until its leg is a free one
_SMOOTHED_S, _REMEMBERED_S = 0.005, 0.1  # in the air, and while it touches the ground
_LEAST_LOAD = 0.1
"""Share of the torque limits: friction of the joints and errors of the model are no load."""


class FreeLegs:
    """Observer of torques on legs in the air besides motors and gravity: something pushes them, or is in their way.

    In the air the equations of motion of a leg's joints hold no unknown force: the measured torque of a tick, less
    ``M a + h`` at the measured state and the change of the measured velocity, is what it was opposed by. On the ground
    it tells nothing, because a foot that stands still does so whatever pushes the leg: what was known is remembered.

    Args:
        robot: the controller's model.
        period: time between two ticks, s.

    Attributes:
        opposed: (nu,) torque that acted in vain over the last tick, N.m, that of the ground included; NaN if unknown.
        load: (nu,) torques of pushes on the legs, N.m, smoothed; zero where they are small.

    Raises:
        InputError: a robot without feet on legs of their own, or a period that is not positive.
    """

    def __init__(self, robot: Robot, period: float) -> None:
        instance("robot", robot, Robot)
        kernel = StageKernel.of(_opposed_torques, robot)
        memory = {name: np.zeros(size) for name, size in kernel.input_sizes.items()}
        rate = 1.0 / duration_of("period", period)
        memory["settings"][:] = rate, *(math.exp(-period / each) for each in (_SMOOTHED_S, _REMEMBERED_S))
        self._memory, self._next = memory, np.zeros_like(memory["state"])
        self.opposed, self.load = np.full(robot.nu, np.nan), np.zeros(robot.nu)
        self._run = kernel.bind(1, **memory, state_next=self._next, opposed=self.opposed, load=self.load)
        self.reset()

    def reset(self) -> None:
        """Forget what was measured."""
        self._memory["state"][:] = self.load[:] = 0.0
        self._memory["v"][:] = np.nan

    def update(self, state: RobotState, missed: int = 0) -> Array:
        """Take the measured state of this tick, after ``missed`` without update, and return :attr:`load`."""
        memory = self._memory
        memory["v_next"][:] = state.v if missed == 0 else np.nan
        memory["torques"][:] = np.nan if state.torques is None else state.torques
        memory["touching"][:] = True if state.contacts is None else state.contacts
        self._run()
        memory["state"][:], memory["q"][:], memory["v"][:] = self._next, state.q, state.v
        return self.load


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

    What opposes the torques of a leg in the air (:class:`FreeLegs`) is ``f sign(v) + b``, with the friction f and the
    mean b of all that is wrong with the model. Both follow in least squares over the joint's recent motion, with fading
    memory, and f only if it moved both ways: ``f = (n S_sr - S_s S_r) / (n^2 - S_s^2)`` with the sums of signs s and
    residuals r, whose denominator is the excitation.

    A robot that stands excites nothing, not even while it is pushed: twelve forces of the feet and an unknown wrench
    leave no equation of motion over. The first steps are enough, and what was learnt stays.

    Args:
        robot: the controller's model; its own joint friction is where the estimate begins.
        period: time between two ticks, s.
        settings: see :class:`JointFrictionSettings`.

    Attributes:
        friction: (nu,) to compensate, N.m; a live view.
        estimate: (nu,) least-squares value at the last tick of each joint, bounded, N.m.
        excited: (nu,) whether each joint has moved enough, at one time, for an estimate; the others are assumed to have
            the same share of their torque limit.

    Raises:
        InputError: a robot without feet on legs of their own, or a period that is not positive.
    """

    def __init__(self, robot: Robot, period: float, settings: JointFrictionSettings | None = None) -> None:
        self.settings = s = JointFrictionSettings() if settings is None else settings
        instance("settings", s, JointFrictionSettings)
        self._free = FreeLegs(robot, period)
        self._period = period
        self._legs = _legs(robot)
        self._keep = np.exp(-period / s.memory_s)
        self._follow = -np.expm1(-period / s.rise_s)
        self._least = s.excitation_s / period
        self._highest = s.largest_share * robot.effort_limit
        self._effort = robot.effort_limit.copy()
        self.friction = np.minimum(robot.joint_friction, self._highest)
        self.estimate = self.friction.copy()
        self.excited = np.zeros(robot.nu, dtype=np.bool_)
        self._rates = np.zeros(robot.nu)
        self._clear = np.zeros(robot.nc)  # s that each leg has been in the air
        self._sums = np.zeros((4, robot.nu))  # of ones, signs, residuals, signs times residuals
        self._memory: tuple[NDArray[Any], ...] = self.friction, self.estimate, self.excited, self._clear, self._sums
        self.reset()

    def reset(self) -> None:
        """Forget what was measured, but not the friction."""
        self._clear[:] = self._sums[:] = 0.0
        self._free.reset()

    def state(self) -> tuple[NDArray[Any], ...]:
        """Return a copy of the state: estimates, times in the air, and sums of the regression."""
        return tuple(each.copy() for each in self._memory)

    def set_state(self, state: tuple[NDArray[Any], ...]) -> None:
        """Continue from another estimator's state."""
        for mine, theirs in zip(self._memory, state, strict=True):
            mine[:] = theirs

    def update(self, state: RobotState, stance: BoolArray, missed: int = 0) -> Array:
        """Take the measured state of this tick, after ``missed`` without update, and return :attr:`friction`.

        Args:
            state: measured.
            stance: (nc,) feet that are to carry.
            missed: ticks before this one in which nothing was measured.
        """
        self._free.update(state, missed)
        flying = ~stance if state.contacts is None else ~(stance | state.contacts)
        self._clear[:] = np.where(flying, self._clear + self._period, 0.0)
        free = np.asarray(self._legs[self._clear > _CLEAR_S].any(axis=0))
        if bool(free.any()) and not missed:
            self._learn(free)
        self._rates[:] = state.v[-len(self._rates) :]
        return self.friction

    def _learn(self, free: BoolArray) -> None:
        rates, residual = self._rates, self._free.opposed  # of the state from which the tick's mean acceleration began
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
    if not robot.floating_base or robot.nq - 7 != robot.nu or robot.nc == 0:
        raise InputError("robot", robot.name, "a floating base, joints of one coordinate each, and contact frames")
    legs = np.zeros((robot.nf, robot.nu), dtype=np.bool_)
    for foot, frame in enumerate(robot.foot_ids):
        legs[foot, [robot.model.joints[joint].idx_v - 6 for joint in leg_joints(robot, frame)]] = True
    legs[:, legs.sum(axis=0) > 1] = False
    return legs[robot.foot_points.of]


def _opposed_torques(robot: Robot) -> ca.Function:
    """One update. State: ticks since each contact point touched the ground, and the smoothed torques."""
    sizes = {"q": robot.nq, "v": robot.nv, "v_next": robot.nv, "torques": robot.nu, "touching": robot.nc}
    sizes |= {"settings": 3, "state": robot.nc + robot.nu}
    given = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    rate, keep, remembered = ca.vertsplit(given["settings"])
    motion = robot.symbolic.rnea(given["q"], given["v"], (given["v_next"] - given["v"]) * rate)[6:]
    opposed = given["torques"] - motion
    ticks, smoothed = ca.vertsplit(given["state"], [0, robot.nc, robot.nc + robot.nu])
    ticks = ca.if_else(given["touching"], 0.0, ticks + 1.0)
    legs = _legs(robot)
    # A tick counts that began and ended without contact.
    free = ca.vertcat(*(ca.mmin(ticks[np.flatnonzero(of).tolist()]) > 1.0 if of.any() else ca.SX(0) for of in legs.T))
    free = ca.logic_and(free, ca.fabs(ca.sum1(opposed)) < math.inf)
    smoothed = ca.if_else(free, keep * smoothed + (1.0 - keep) * opposed, remembered * smoothed)
    least = _LEAST_LOAD * robot.effort_limit
    load = -ca.sign(smoothed) * ca.fmax(ca.fabs(smoothed) - least, 0.0)
    outputs = ca.cse([ca.vertcat(ticks, smoothed), opposed, load])
    return ca.Function("opposed_torques", list(given.values()), outputs, list(given), ["state_next", "opposed", "load"])
