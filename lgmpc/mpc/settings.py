"""What predictive controllers are told once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

from lgmpc.errors import InputError
from lgmpc.solvers.qp import QP_SOLVERS

__all__ = [
    "CentroidalMpcSettings",
    "CentroidalWeights",
    "FullBodyMpcSettings",
    "FullBodyWeights",
    "KinodynamicMpcSettings",
    "KinodynamicWeights",
    "LqrSettings",
    "MpcSettings",
    "WholeBodyMpcSettings",
]


@dataclass(frozen=True)
class CentroidalWeights:
    """Weights of the squared deviations; a number for all three axes, or one an axis (world x, y, z).

    Attributes:
        com: 1/m^2.
        linear_momentum: 1/(N.s)^2.
        angular_momentum: 1/(N.m.s)^2.
        force: 1/N^2, positive; deviation of each contact's force from its share of the weight.
        terminal: factor on the state's weights at the last node.

    Raises:
        InputError: a weight that is negative or not finite, or no positive force weight.
    """

    com: float | tuple[float, float, float] = 1e3
    linear_momentum: float | tuple[float, float, float] = 10.0
    angular_momentum: float | tuple[float, float, float] = 1e3
    force: float | tuple[float, float, float] = 1e-3
    terminal: float = 10.0

    def __post_init__(self) -> None:
        """Refuse weights that make no sense."""
        for item in fields(self):
            value = getattr(self, item.name)
            numbers = tuple(value) if isinstance(value, Sequence) else (value,)
            control = item.name in self._controls
            lowest = "positive" if control else "non-negative"
            if len(numbers) not in (1, 3) or not all(_is_number(n) and n >= 0 for n in numbers):
                raise InputError(f"weights.{item.name}", value, f"a finite {lowest} number, or one an axis")
            if control and min(numbers) == 0:
                expected = "positive numbers: without them the controls are not unique"
                raise InputError(f"weights.{item.name}", value, expected)

    @property
    def _controls(self) -> tuple[str, ...]:
        """Weights of controls, which have to be positive."""
        return ("force",)

    def state(self) -> list[float]:
        """Return the nine weights of a state."""
        return [w for value in (self.com, self.linear_momentum, self.angular_momentum) for w in _per_axis(value)]

    def forces(self, contacts: int) -> list[float]:
        """Return the weights of all contacts' forces."""
        return _per_axis(self.force) * contacts


@dataclass(frozen=True)
class KinodynamicWeights(CentroidalWeights):
    """Those of :class:`CentroidalWeights`, and of what the joints do.

    Attributes:
        base_orientation: 1/rad^2; turn from the reference.
        posture: 1/rad^2; joints from the reference posture.
        joint_velocity: 1/(rad/s)^2, positive.

    Raises:
        InputError: a weight that is negative or not finite, or no positive weight of a control.
    """

    angular_momentum: float | tuple[float, float, float] = 10.0
    base_orientation: float | tuple[float, float, float] = 1.0
    posture: float = 0.1
    joint_velocity: float = 1e-3

    @property
    def _controls(self) -> tuple[str, ...]:
        return ("force", "joint_velocity")


@dataclass(frozen=True)
class FullBodyWeights(CentroidalWeights):
    """Those of :class:`CentroidalWeights`, and of what joints and motors do.

    Attributes:
        base_orientation: 1/rad^2; turn from the reference.
        posture: 1/rad^2; joints from the reference posture.
        joint_velocity: 1/(rad/s)^2.
        effort: 1/(N.m)^2, positive.

    Raises:
        InputError: a weight that is negative or not finite, or no positive weight of a control.
    """

    angular_momentum: float | tuple[float, float, float] = 10.0
    base_orientation: float | tuple[float, float, float] = 1.0
    posture: float = 0.1
    joint_velocity: float = 1e-3
    effort: float = 1e-3

    @property
    def _controls(self) -> tuple[str, ...]:
        return ("effort",)


@dataclass(frozen=True)
class MpcSettings:
    """Horizon and limits of any MPC.

    Attributes:
        nodes: number of intervals of the horizon, at least 2.
        node_duration: length of each, s.
        friction: coefficient that the plan relies on.
        facets: sides of the pyramid inscribed in the friction cone, at least 3.
        normal_force_min: of a foot in contact, N.
        normal_force_max: N.
        qp_solver: name of the solver of the subproblems.
        sqp_iterations: subproblems solved in each update.
        stale_after: updates in a row that may fail before the plan is declared stale.

    Raises:
        InputError: a value that cannot be used; names it.
    """

    nodes: int = 20
    node_duration: float = 0.02
    friction: float = 0.6
    facets: int = 8
    normal_force_min: float = 0.5
    normal_force_max: float = 30.0
    qp_solver: str = "riccati"
    sqp_iterations: int = 1
    stale_after: int = 5

    def __post_init__(self) -> None:
        """Refuse what cannot be used."""
        for name, lowest in (("nodes", 2), ("facets", 3), ("sqp_iterations", 1), ("stale_after", 1)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < lowest:
                raise InputError(name, value, f"a whole number of at least {lowest}")
        for name in ("node_duration", "friction", "normal_force_max"):
            value = getattr(self, name)
            if not (_is_number(value) and value > 0):
                raise InputError(name, value, "a positive number")
        if not (_is_number(self.normal_force_min) and 0 <= self.normal_force_min < self.normal_force_max):
            expected = f"a number from 0 to below normal_force_max ({self.normal_force_max})"
            raise InputError("normal_force_min", self.normal_force_min, expected)
        if self.qp_solver not in QP_SOLVERS:
            raise InputError("qp_solver", self.qp_solver, "a solver of quadratic programmes", QP_SOLVERS)


@dataclass(frozen=True)
class CentroidalMpcSettings(MpcSettings):
    """Those of :class:`MpcSettings`, and weights.

    Attributes:
        weights: of the cost.
    """

    weights: CentroidalWeights = field(default_factory=CentroidalWeights)


@dataclass(frozen=True)
class LqrSettings(MpcSettings):
    """Those of :class:`MpcSettings` that a regulator has a use for (horizon of the prediction, limits), and weights.

    Attributes:
        weights: of the cost, an interval each; ``terminal`` is not used.
    """

    weights: CentroidalWeights = field(default_factory=CentroidalWeights)


@dataclass(frozen=True)
class WholeBodyMpcSettings(MpcSettings):
    """Those of :class:`MpcSettings`, and how far joints should go.

    Attributes:
        reach: rad; how far from the reference posture a joint may be in a plan that is worth following. Less than what
            stretches a leg: a stretched leg is singular, and linearised there no plan makes sense.

    Raises:
        InputError: a value that cannot be used; names it.
    """

    reach: float = 0.9

    def __post_init__(self) -> None:
        """Refuse what cannot be used."""
        super().__post_init__()
        if not (_is_number(self.reach) and self.reach > 0):
            raise InputError("reach", self.reach, "a positive number, rad")


@dataclass(frozen=True)
class KinodynamicMpcSettings(WholeBodyMpcSettings):
    """Those of :class:`WholeBodyMpcSettings`, and weights.

    Attributes:
        weights: of the cost.
    """

    weights: KinodynamicWeights = field(default_factory=KinodynamicWeights)


@dataclass(frozen=True)
class FullBodyMpcSettings(WholeBodyMpcSettings):
    """Those of :class:`WholeBodyMpcSettings`, and weights.

    Attributes:
        weights: of the cost.
    """

    weights: FullBodyWeights = field(default_factory=FullBodyWeights)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _per_axis(value: float | tuple[float, float, float]) -> list[float]:
    return list(value) if isinstance(value, Sequence) else [value] * 3
