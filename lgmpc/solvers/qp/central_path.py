"""Mehrotra's predictor and corrector, in the rows of a problem.

It is the part of an interior point method without the minimisation of the cost with penalised rows.

A row ``lower <= row <= upper`` has a slack ``s = +-(bound - row)`` and a multiplier ``z`` for each of its bounds. The
Newton step on ``s z = target`` minimises the cost with the penalties

    sum_bounds  1/2 (z / s) (row - bound)^2 +- (2 z + (target - s z) / s) row,

which is, row by row, one weight and one target of :class:`~lgmpc.solvers.qp.protocol.RiccatiSolver`. Mehrotra, "On the
implementation of a primal-dual interior point method", SIAM J. Optim. 2, 1992.
"""

from __future__ import annotations

import numpy as np

from lgmpc.typing import Array

__all__ = ["CentralPath", "nearest_in"]

_FLOOR = 0.3  # least multiplier at first, as a share of the largest
_TO_BOUNDARY = 0.995  # share of the longest step that keeps slacks and multipliers positive
_SHORTEST = 1e-6  # a shorter step counts as none
_LONG = 0.8  # a step as long as this separates the active bounds from the others
_SETTLED = 0.02  # share of the active bounds that may still change when they count as identified


def nearest_in(values: Array, lower: Array, upper: Array) -> Array:
    """Return the nearest points to values within bounds (numpy's clip takes three times as long on small arrays)."""
    out: Array = np.maximum(values, lower)
    np.minimum(out, upper, out=out)
    return out


class CentralPath:
    """Slacks and multipliers of all finite bounds on their way to a solution; see the module.

    The calls of a solve: :meth:`begin`, :meth:`start`, and in each iteration :meth:`predict`, :meth:`correct`,
    :meth:`step`, with a minimisation after each but :meth:`start` and :meth:`step`, the one after :meth:`correct` with
    the same weights as before.

    Args:
        lower: (N, ng) bounds of the rows; minus infinity for none.
        upper: (N, ng) the same from above. Where both are equal there is no interior: such rows are penalised
            throughout, with a multiplier that grows (Hestenes' and Powell's).
        start: penalty of all rows at the first point; some control weights.
        penalty: of rows with equal bounds, much larger.

    Attributes:
        settled: whether the last steps identified the active bounds.
    """

    def __init__(self, lower: Array, upper: Array, start: float, penalty: float) -> None:
        self._lower, self._upper, self._start, self._penalty = lower, upper, start, penalty
        self._equal = np.flatnonzero(lower == upper)
        self._fixed = upper.ravel()[self._equal]
        self._held = np.zeros(self._equal.size)
        between = lower != upper
        low, high = np.flatnonzero(np.isfinite(lower) & between), np.flatnonzero(np.isfinite(upper) & between)
        self._row = np.concatenate([low, high])  # the row of each bound
        self._sign = np.concatenate([np.full(low.size, -1.0), np.ones(high.size)])
        self._bound = np.concatenate([lower.ravel()[low], upper.ravel()[high]])
        self._active = np.zeros(self._row.size, dtype=bool)
        self.settled = False

    def begin(self, weights: Array, targets: Array) -> None:
        """Write (N, ng) the penalties of the first point: targets are the values within bounds nearest to zero."""
        weights[...] = self._start
        weights.ravel()[self._equal] = self._penalty
        targets[...] = nearest_in(np.zeros_like(targets), self._lower, self._upper)

    def start(self, rows: Array) -> None:
        """Make slacks and multipliers from the rows (N, ng) of the first point."""
        gap = self._sign * (self._bound - rows.ravel()[self._row])
        worst = max(-float(gap.min(initial=0.0)), 1e-6)
        self._slack = np.maximum(gap, worst)
        self._force = self._start * (np.maximum(-gap, 0.0) + _FLOOR * worst)

    def predict(self, weights: Array, targets: Array) -> None:
        """Write the penalties of the step to ``s z = 0``."""
        self._stiffness = self._force / self._slack
        self._weight = self._sum(self._stiffness)
        weights[...] = self._weight.reshape(weights.shape)
        weights.ravel()[self._equal] = self._penalty
        self._change = -self._slack * self._force
        self._aim(targets)

    def correct(self, rows: Array, targets: Array) -> None:
        """Write, from the rows of the prediction, the penalties of the step to the central path, of second order."""
        slack_step, force_step = self._steps(rows)
        # Of an active bound the prediction takes the slack away, of another one the multiplier.
        active = slack_step * self._force < force_step * self._slack
        self._few = np.count_nonzero(active != self._active) <= _SETTLED * np.count_nonzero(active)
        self._active = active
        length = self._longest(slack_step, force_step)
        total = -float(self._change.sum())
        left = float(np.vdot(self._slack + length * slack_step, self._force + length * force_step))
        centre = total / self._row.size * (left / total) ** 3 if total > 0.0 else 0.0
        self._change += centre - slack_step * force_step
        self._aim(targets)

    def step(self, rows: Array) -> bool:
        """Move towards the rows of the correction; False if that is impossible."""
        slack_step, force_step = self._steps(rows)
        length = min(1.0, _TO_BOUNDARY * self._longest(slack_step, force_step))
        if not length > _SHORTEST:  # or NaN
            return False
        self._slack += length * slack_step
        self._force += length * force_step
        self._held += length * self._penalty * (rows.ravel()[self._equal] - self._fixed)
        self._rows = rows
        self.settled = bool(self._few) and length > _LONG
        return True

    def active_rows(self) -> tuple[Array, Array]:
        """Return rows (N, ng), active ones at their bounds, and their multipliers (N, ng)."""
        rows = nearest_in(self._rows, self._lower, self._upper)
        rows.ravel()[self._row[self._active]] = self._bound[self._active]
        multipliers = self._sum(self._sign * self._force * self._active)
        multipliers[self._equal] = self._held
        return rows, multipliers.reshape(rows.shape)

    def _sum(self, of_bounds: Array) -> Array:
        """Return the sum over the bounds of each row."""
        total: Array = np.bincount(self._row, of_bounds, self._lower.size).astype(np.float64, copy=False)
        return total

    def _aim(self, targets: Array) -> None:
        pull = self._sum(self._sign * (self._change / self._slack + 2.0 * self._force) - self._stiffness * self._bound)
        targets[...] = np.divide(-pull, self._weight, out=pull, where=self._weight > 0.0).reshape(targets.shape)
        targets.ravel()[self._equal] = self._fixed - self._held / self._penalty

    def _steps(self, rows: Array) -> tuple[Array, Array]:
        """Return the steps of slacks and multipliers that new rows imply."""
        slack = self._sign * (self._bound - rows.ravel()[self._row]) - self._slack
        return slack, (self._change - self._force * slack) / self._slack

    def _longest(self, slack_step: Array, force_step: Array) -> float:
        """Return the longest step, at most 1, that makes no slack and no multiplier negative."""
        shortest = min((slack_step / self._slack).min(initial=-1.0), (force_step / self._force).min(initial=-1.0))
        return -1.0 / float(shortest)
