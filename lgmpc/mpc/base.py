"""The base of every predictive controller: keeps the last plan, and returns it when an update fails."""

from __future__ import annotations

import logging
import math
import time
from abc import ABC, abstractmethod

import numpy as np

from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import MpcStatus, Plan
from lgmpc.mpc.settings import MpcSettings
from lgmpc.ocp import KktResidual
from lgmpc.typing import Array, BoolArray

__all__ = ["GRAVITY", "BaseMpc", "checked_mass", "input_error", "weight_shares", "write_intervals"]

GRAVITY: tuple[float, float, float] = (0.0, 0.0, -9.81)
"""Acceleration of gravity unless given, world axes, m/s2."""

_LOG = logging.getLogger(__name__)


class BaseMpc(ABC):
    """Counts failures, and returns the last fresh plan after one, whose horizon includes the present time.

    Args:
        settings: horizon, limits.
        mass: mass of the robot, kg.

    Attributes:
        settings: as given.
        mass: as given, kg.
        failures: updates without a fresh plan so far.
        failures_in_a_row: since the last fresh plan.

    Raises:
        InputError: mass not positive.
    """

    def __init__(self, settings: MpcSettings, mass: float) -> None:
        self.settings: MpcSettings = settings
        self.mass = checked_mass(mass)
        self.failures = 0
        self.failures_in_a_row = 0
        self._plan: Plan | None = None  # the last fresh one

    def reset(self) -> None:
        """Discard the last plan and the failure counts: the next update starts as the first one."""
        self.failures = 0
        self.failures_in_a_row = 0
        self._plan = None

    @abstractmethod
    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured state; see :meth:`lgmpc.mpc.interface.Mpc.update`."""

    @abstractmethod
    def _standing_plan(self, t: float) -> Plan:
        """Return the plan of rest at the reference, all numbers finite: used before any update has succeeded."""

    def _keep(self, plan: Plan, status: MpcStatus, qp_iterations: int, start: float) -> Plan:
        """Store and return a fresh plan; ``start`` is the beginning of the update by the performance counter."""
        self.failures_in_a_row = 0
        self._plan = plan.stamped(status, qp_iterations, time.perf_counter() - start)
        return self._plan

    def _fall_back(self, status: MpcStatus, t: float, qp_iterations: int, start: float) -> Plan:
        """Return the last fresh plan with the status of the failure; STALE after too many consecutive failures."""
        self.failures += 1
        self.failures_in_a_row += 1
        if self.failures_in_a_row == 1:
            _LOG.warning("%s update at %.3f s: %s (%s)", type(self).__name__, t, status.name, status.value)
        if self.failures_in_a_row > self.settings.stale_after:
            status = MpcStatus.STALE
        plan = self._standing_plan(t if math.isfinite(t) else 0.0) if self._plan is None else self._plan
        return plan.stamped(status, qp_iterations, time.perf_counter() - start)

    def _make_plan(self, t: float, xs: Array, forces: Array, kkt: KktResidual) -> Plan:
        """Return a plan whose status and timing are filled in later."""
        xs.flags.writeable = forces.flags.writeable = False
        node_s, status = self.settings.node_s, MpcStatus.NOT_FINITE
        return Plan(t, node_s, self.mass, xs, forces, status, 0, kkt, 0.0)


def checked_mass(mass: float) -> float:
    """Return the mass, kg.

    Raises:
        InputError: it is not positive.
    """
    if not (math.isfinite(mass) and mass > 0):
        raise InputError("mass", mass, "a positive number, kg")
    return float(mass)


def weight_shares(flags: Array, weight: Array) -> Array:
    """Return (N, nc, 3) forces that hold the weight (3,), an even share for each foot whose flag (N, nc) is 1."""
    share = weight / np.maximum(np.add.reduce(flags, axis=1), 1.0)[:, None]
    shares: Array = flags[:, :, None] * share[:, None, :]
    return shares


def write_intervals(target: Array, values: Array | BoolArray) -> None:
    """Write the values of N intervals into the rows of N + 1 nodes; the last node has those of the last interval.

    Raises:
        ValueError: the shapes differ.
    """
    if values.shape[1:] != target.shape[1:]:
        raise ValueError(f"shape {values.shape} instead of {(len(target) - 1, *target.shape[1:])}")
    target[:-1] = values
    target[-1] = target[-2]


def input_error(error: ValueError, nodes: int, contacts: int) -> InputError:
    """Return the error of an update whose arrays have wrong shapes."""
    expected = (
        f"points and normals ({nodes}, {contacts}, 3), flags and friction ({nodes}, {contacts}), com and com_velocity"
        f" ({nodes + 1}, 3), q ({nodes + 1}, nq), wrench ({nodes}, 6)"
    )
    return InputError("inputs of the MPC", str(error), expected)
