"""Bounded controls without constraints: a smooth saturation of the control."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.actions.dynamics import Dynamics, Motion
from lgmpc.actions.implicit import Unknowns
from lgmpc.costs import Parameter
from lgmpc.errors import InputError
from lgmpc.typing import instance, numbers

__all__ = ["Squashed"]


class Squashed(Dynamics):
    """Dynamics under ``s(u)``, which is u within bounds and saturates smoothly beyond them; FDDP needs no bounds then.

        s(u) = 1/2 (lower + upper + sqrt((u - lower)^2 + d^2) - sqrt((u - upper)^2 + d^2)),   d = smoothness (upper -
        lower)

    lies strictly between the bounds (Marti-Saumell, Sola, Mastalli, Santamaria-Navarro, "Squash-box feasibility driven
    differential dynamic programming", IROS 2020; Crocoddyl's SquashingModelSmoothSat).

    Parameters: those of the dynamics, ``squash_lower`` and ``squash_upper`` (nu,).

    Args:
        dynamics: under the saturated control.
        lower: (nu,) lower bounds, finite.
        upper: (nu,) upper bounds, finite.
        smoothness: width of the bends relative to the distance of the bounds.

    Raises:
        InputError: bounds that are not finite or not in order, or a smoothness that is not positive and finite.
    """

    def __init__(self, dynamics: Dynamics, lower: ArrayLike, upper: ArrayLike, smoothness: float = 0.05) -> None:
        instance("dynamics", dynamics, Dynamics, "an object of a class of Dynamics")
        shapes = (), (dynamics.nu,)
        bounds = numbers("lower", lower, *shapes), numbers("upper", upper, *shapes)
        low, high = (np.broadcast_to(bound, dynamics.nu) for bound in bounds)
        if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
            raise InputError("lower, upper", f"{low.tolist()}, {high.tolist()}", "finite bounds, lower below upper")
        if not 0.0 < float(numbers("smoothness", smoothness, ())) < np.inf:
            raise InputError("smoothness", smoothness, "a finite number above 0")
        self.base, self.smoothness = dynamics, smoothness
        parameters = (
            Parameter("squash_lower", dynamics.nu, "lower bounds of the saturated control", low),
            Parameter("squash_upper", dynamics.nu, "upper bounds of the saturated control", high),
        )
        super().__init__(dynamics.model, dynamics.nu, (*dynamics.parameters, *parameters))

    def motion(self, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns) -> Motion:
        """Return the motion under the saturated control."""
        return self.base.motion(q, v, self.squash(u, values), values, unknowns)

    def squash(self, u: Any, values: Mapping[str, Any]) -> Any:
        """Return the saturated control (nu,)."""
        low, high = values["squash_lower"], values["squash_upper"]
        bend = (self.smoothness * (high - low)) ** 2
        return 0.5 * (low + high + ca.sqrt((u - low) ** 2 + bend) - ca.sqrt((u - high) ** 2 + bend))
