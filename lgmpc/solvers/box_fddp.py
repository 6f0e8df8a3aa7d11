"""Feasibility-driven differential dynamic programming with bounds on the controls.

Mastalli, Merkt, Marti-Saumell, Ferrolho, Sola, Mansard, Vijayakumar, "A feasibility-driven approach to control-limited
DDP", Autonomous Robots 46, 2022, with another sweep: see :class:`~lgmpc.solvers.box.BoxSweep`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lgmpc.ocp import Trajectory
from lgmpc.solvers.box import BoxSweep, control_bounds
from lgmpc.solvers.fddp import Fddp
from lgmpc.status import Status
from lgmpc.typing import Array

__all__ = ["BoxFddp"]


class BoxFddp(Fddp):
    """Feasibility-driven DDP whose controls stay within bounds: every constraint row bounds one control.

    The bounds are those of the actions' path constraints and may depend on parameters. The sweep minimises over the
    boxes of all nodes together (:class:`~lgmpc.solvers.box.BoxSweep`), with and without gaps, and the roll-out clips
    to them.

    Raises:
        InputError: a path constraint that is not a bound on a control.
    """

    name = "box FDDP"

    def _check_constraints(self) -> None:
        self._bounds = control_bounds(self.problem)

    def _make_sweep(self, progress: Callable[[str], None] | None) -> BoxSweep:
        self._box = BoxSweep(self.functions, progress)
        return self._box

    def _begin(self, guess: Trajectory) -> Status | None:
        f = self.functions
        self._bounds.write(self.problem.parameters, f.u_lower, f.u_upper)
        self._box.held[...] = 0
        if not (f.u_lower <= f.u_upper).all():
            super()._begin(guess)
            nan = np.isnan(f.u_lower).any() or np.isnan(f.u_upper).any()
            return Status.NOT_FINITE if nan else Status.INFEASIBLE
        return super()._begin(Trajectory(guess.xs, np.clip(guess.us, f.u_lower, f.u_upper)))

    def _split(self, gradient: Array) -> tuple[Array, Array]:
        f = self.functions
        held = ((f.us <= f.u_lower) & (gradient > 0.0)) | ((f.us >= f.u_upper) & (gradient < 0.0))
        return self._bounds.multipliers(np.where(held, -gradient, 0.0)), np.where(held, 0.0, gradient)

    def _expected_from_gaps(self) -> float:
        return 0.0  # the sweep's own roll-out has accounted for them
