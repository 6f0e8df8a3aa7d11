"""Disturbance observer: the external wrench on the robot, from its centroidal momentum and the contact forces."""

import math
from bisect import bisect_left, insort
from collections import deque
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.estimation.checks import duration_of, number
from lgmpc.typing import Array

_NOISE_MEMORY = 0.2  # s


class WrenchObserver:
    r"""First-order momentum observer of the external wrench about the centre of mass, world axes.

    The centroidal momentum obeys ``h' = r + w``, where ``r = sum_i [f_i; (p_i - c) x f_i] + [m g; 0]``. The controller
    computes the rate that its own forces and the present estimate of ``w`` should give, ``A_G a + A_G' v`` at the
    acceleration ``a`` that it commands; ``r`` is this without the estimate. The deviation of the measured rate is the
    estimate's error, and is filtered with time constant ``T``:
    ``w <- w + (1 - exp(-dt / T)) ((h - h_last) / dt - r - w)``. Where commands act with a delay, ``r``
    is that of the commands which acted between the two measurements.

    Noise of the measured momentum, of standard deviation ``s``, makes one of ``s / T`` in the estimate: where that is
    more than ``noise_force``, ``T`` grows until it is not. Successive errors are alike where a wrench changes, and
    opposite where they are white noise: their covariance is ``-s^2 / dt^2`` then, averaged over the last 0.2 s.
    Same idea as the generalised-momentum observer of De Luca and Mattone (ICRA 2005), at the centroidal level.

    Args:
        period: time between two updates, s.
        time_constant: filter time constant, s, at least; longer is calmer and slower.
        force_limit: N; the estimate is scaled back to this force, so that a fault cannot demand impossible forces.
        delay: from a measurement of the momentum until the command that it led to acts, s.
        noise_force: largest standard deviation of the estimated force in each axis, N, as far as noise causes it.

    Attributes:
        wrench: (6,) current estimate [force; moment], N and N.m.

    Raises:
        InputError: if period, time constant or limit is not positive, or the delay negative.
    """

    def __init__(
        self, period: float, time_constant: float = 0.01, force_limit: float = math.inf, delay: float = 0.0,
        noise_force: float = math.inf,
    ) -> None:  # fmt: skip
        for name, value in (("period", period), ("time_constant", time_constant)):
            duration_of(name, value)
        for name, value in (("force_limit", force_limit), ("noise_force", noise_force)):
            number(name, value, "a positive number", above=0.0, finite=False)
        number("delay", delay, "a number of seconds that is not negative", 0.0)
        # An interval between two measurements overlaps those of at most two commands.
        whole, part = divmod(round(delay / period, 6), 1.0)
        self._rates = np.full((int(whole) + (2 if part else 1), 6), math.nan)  # r of the commands, the newest first
        self._least_time = time_constant
        memory = -math.expm1(-period / _NOISE_MEMORY)
        self._given, self._state, self._next = np.zeros(6), np.zeros(17), np.zeros(17)
        self.wrench = self._state[6:12]
        settings = np.array([period, 1.0 / period, time_constant, force_limit, noise_force, memory, part])
        self._run = StageKernel.of(_observation).bind(
            1, momentum=self._given, state=self._state, older=self._rates[-1], newer=self._rates[-2 if part else -1],
            settings=settings, state_next=self._next,
        )  # fmt: skip
        self.reset()

    def reset(self) -> None:
        """Clear the history: the estimate is zero until a first expectation has been compared."""
        self._rates[:] = self._state[:6] = math.nan
        self._state[6:] = 0.0
        self._state[16] = self._least_time

    def state(self) -> tuple[Array, Array]:
        """Return a copy of the state: the estimate with its filter's memory, and the rates of the last commands."""
        return self._state.copy(), self._rates.copy()

    def set_state(self, state: tuple[Array, Array]) -> None:
        """Continue from another observer's state; of commands further back than its memory nothing is known."""
        self._state[:], rates = state
        self._rates[:] = math.nan
        count = min(len(rates), len(self._rates))
        self._rates[:count] = rates[:count]

    @property
    def time_constant(self) -> float:
        """The present filter time constant, s."""
        return float(self._state[16])

    def update(self, momentum: Array) -> Array:
        """Take the measured centroidal momentum (6,) of this tick and return the new estimate (6,), a live buffer."""
        self._given[...] = momentum
        self._run()
        self._state[...] = self._next
        return self.wrench

    def expect(self, momentum_rate: Array, wrench: Array | None = None) -> None:
        """Store the momentum rate (6,) of the command that was just computed.

        Args:
            momentum_rate: with the wrench that the command was computed for.
            wrench: (6,) that wrench; the estimate unless given. An estimate that the command leaves out must not be
                taken for included: it would grow for as long as something pushes.
        """
        if len(self._rates) > 1:
            self._rates[1:] = self._rates[:-1]
        np.subtract(momentum_rate, self.wrench if wrench is None else wrench, out=self._rates[0])

    def skip(self) -> None:
        """Leave the command that was just computed out of the estimate: its forces are not known."""
        self._rates[1:] = self._rates[:-1]
        self._rates[0] = math.nan

    def miss(self, ticks: int) -> None:
        """Account for ``ticks`` without update before the next one: the last command went on, nothing was measured."""
        for _ in range(min(ticks, len(self._rates))):
            self._rates[1:] = self._rates[:-1]
        self._state[:6] = math.nan


class SteadyForce:
    """The part of an estimated force that lasts: the median of its horizontal components over a window.

    A force that acts for less than half of the window leaves it at zero: a push, and the tail of its estimate.

    Args:
        period: time between two samples, s.
        least: N; a component counts as far as it is beyond this: errors of the estimate are no load.
        window: s.

    Attributes:
        force: (x, y), world axes, N.

    Raises:
        InputError: a period or a window that is not positive.
    """

    def __init__(self, period: float, least: float = 0.0, window: float = 0.8) -> None:
        count = max(round(duration_of("window", window) / duration_of("period", period)), 1)
        self._count, self._least = count, least
        self.reset()

    def reset(self) -> None:
        """Discard all samples."""
        self._samples = deque([(0.0, 0.0)] * self._count)
        self._sorted = [0.0] * self._count, [0.0] * self._count
        self.force = (0.0, 0.0)

    def update(self, force: Array) -> tuple[float, float]:
        """Take an estimate of the force (at least x and y), world axes, N; return :attr:`force`."""
        x, y = force[:2].tolist()
        self._samples.append((x, y))
        middles = []
        for ordered, old, new in zip(self._sorted, self._samples.popleft(), (x, y), strict=True):
            del ordered[bisect_left(ordered, old)]  # ten times faster than numpy's median of all
            insort(ordered, new)
            middles.append(0.5 * (ordered[self._count // 2] + ordered[(self._count - 1) // 2]))
        fx, fy = (math.copysign(max(abs(f) - self._least, 0.0), f) for f in middles)
        self.force = (fx, fy)
        return self.force


def _observation() -> ca.Function:
    """One update. State: momentum of the last one (6), wrench (6), force errors (3), their covariance, time constant.

    The covariance is that of successive errors, the mean of the three axes, N2. An update whose numbers are not all
    finite keeps everything but the momentum.
    """
    sizes = {"momentum": 6, "state": 17, "older": 6, "newer": 6, "settings": 7}
    given = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    momentum, state = given["momentum"], given["state"]
    before, wrench, error_before, covariance, time_constant = ca.vertsplit(state, [0, 6, 12, 15, 16, 17])
    period, rate, least_time, force_limit, noise_force, memory, part = ca.vertsplit(given["settings"])
    acted = (1.0 - part) * given["newer"] + part * given["older"]
    error = (momentum - before) * rate - acted - wrench
    product = error[:3] * error_before
    adapted = covariance + memory * ((product[0] + product[1] + product[2]) / 3.0 - covariance)
    noise = period * ca.sqrt(ca.fmax(0.0, -adapted))
    slower = ca.fmax(least_time, noise / noise_force)
    corrected = wrench - ca.expm1(-period / slower) * error
    x, y, z = ca.vertsplit(corrected[:3])
    size = ca.sqrt(x * x + y * y + z * z)
    bounded = ca.if_else(size > force_limit, corrected * (force_limit / size), corrected)
    finite = ca.fabs(ca.sum1(error)) < math.inf
    kept: Any = ca.vertcat(wrench, error_before, covariance, time_constant)
    changed = ca.vertcat(bounded, error[:3], adapted, slower)
    state_next = ca.vertcat(momentum, ca.if_else(finite, changed, kept))
    return ca.Function("wrench_observation", list(given.values()), [state_next], list(given), ["state_next"])
