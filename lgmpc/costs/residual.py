"""Residuals: vectors that a problem minimises (as a cost) or keeps within bounds (as a constraint).

A new residual takes three lines; derivatives and machine code follow from the expression:

    class HandHeight(Residual):
        nr = 1
        def expression(self, s): return s.placement("hand").translation[2] - 1.2

``s`` is a :class:`~lgmpc.costs.StageSymbols`: q, v, u, a, tau, forces, placements, velocities, centre of mass and all
algorithms of ``s.robot``. A value that changes between two solves is a parameter instead of a number:

    class HandHeight(Residual):
        nr = 1
        parameters = (Parameter("height", 1, "of the hand above the ground, m", default=1.2),)
        def expression(self, s): return s.placement("hand").translation[2] - s["height"]

As a cost it is ``CostItem("hand", HandHeight(), weight=10.0)``, as a hard constraint
``ConstraintItem("hand", HandHeight(), lower=0.0, upper=0.3)``; an action takes lists of both. Its parameters are then
called ``hand_height``, ``hand_weight``, ``hand_lower`` and ``hand_upper``, one value a node.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.costs.activations import Activation, Quadratic
from lgmpc.costs.parameters import Parameter
from lgmpc.costs.symbols import MissingQuantityError, StageSymbols
from lgmpc.errors import InputError, LgmpcError
from lgmpc.typing import identifier, numbers


@dataclass(frozen=True)
class CostTerm:
    """The cost ``sum_i weight_i a(residual_i)`` with an activation a.

    Its Hessian is taken as ``J^T diag(weight a'') J`` with the residual's Jacobian J (Gauss-Newton): positive
    semidefinite for weights that are not negative.

    Attributes:
        residual: CasADi column, a function of state, control and parameters.
        activation: a; half the square unless given.
        weight: CasADi column of the same length or a number, a function of the parameters only.
    """

    residual: Any
    activation: Activation = Quadratic()
    weight: Any = 1.0


@dataclass(frozen=True)
class Cost:
    """A sum of terms.

    Attributes:
        terms: any number of them.
    """

    terms: tuple[CostTerm, ...] = ()

    @property
    def value(self) -> Any:
        """The cost, a CasADi scalar."""
        total = ca.SX(0)
        for term in self.terms:
            total += ca.dot(_column(term.weight, term.residual), term.activation.value(term.residual))
        return total

    @property
    def residual(self) -> Any:
        """The residuals of all terms in one column."""
        return ca.vertcat(ca.SX(0, 1), *(term.residual for term in self.terms))

    @property
    def weight(self) -> Any:
        """The weights of all terms in one column."""
        return ca.vertcat(ca.SX(0, 1), *(_column(term.weight, term.residual) for term in self.terms))

    @property
    def gradient(self) -> Any:
        """The activations' first derivatives in one column, not weighted."""
        return ca.vertcat(ca.SX(0, 1), *(term.activation.gradient(term.residual) for term in self.terms))

    @property
    def curvature(self) -> Any:
        """The activations' second derivatives in one column, not weighted."""
        return ca.vertcat(ca.SX(0, 1), *(term.activation.curvature(term.residual) for term in self.terms))


def LeastSquares(residual: Any, weight: Any) -> Cost:  # noqa: N802 - reads as the kind of cost that it makes
    """Return the cost ``1/2 sum_i weight_i residual_i^2``.

    Args:
        residual: CasADi column, a function of state, control and parameters.
        weight: CasADi column of the same length, a function of the parameters only.
    """
    return Cost((CostTerm(residual, Quadratic(), weight),))


@dataclass(frozen=True)
class Bounded:
    """The hard constraint ``lower <= value <= upper``, row by row.

    Attributes:
        value: CasADi column, a function of state, control and parameters.
        lower: CasADi column, a function of the parameters only; minus infinity where there is no bound.
        upper: CasADi column, a function of the parameters only; infinity where there is no bound.
    """

    value: Any
    lower: Any
    upper: Any

    @staticmethod
    def stack(*parts: "Bounded") -> "Bounded":
        """Return the constraints of all parts in one; columns of length zero if there is none."""
        empty = ca.SX(0, 1)
        return Bounded(
            ca.vertcat(empty, *(part.value for part in parts)),
            ca.vertcat(empty, *(part.lower for part in parts)),
            ca.vertcat(empty, *(part.upper for part in parts)),
        )


def _column(weight: Any, residual: Any) -> Any:
    column = ca.SX(weight)
    return ca.repmat(column, residual.shape[0], 1) if column.shape == (1, 1) else column


class Residual(ABC):
    """A column of expressions (see the module for an example).

    Attributes:
        nr: number of entries.
        parameters: quantities that may change between two solves; each is ``s[name]`` in the expression.
    """

    nr: int
    parameters: tuple[Parameter, ...] = ()

    @abstractmethod
    def expression(self, s: StageSymbols) -> Any:
        """Return the (nr,) CasADi column."""


@dataclass(frozen=True, eq=False)
class _Item:
    name: str
    residual: Residual
    own: ClassVar[tuple[tuple[str, str], ...]] = ()
    sign: ClassVar[Literal["any", "not negative"]] = "any"

    def __post_init__(self) -> None:
        identifier("name", self.name)
        if not isinstance(self.residual, Residual):
            is_class = isinstance(self.residual, type)
            got = self.residual.__name__ if is_class else type(self.residual).__name__
            expected = f"a residual, as {got}(...)" if is_class else "a Residual, see lgmpc.costs.library"
            raise InputError(f"residual of '{self.name}'", got, expected)
        rows = getattr(self.residual, "nr", None)
        if not isinstance(rows, int | np.integer) or rows < 0:
            raise InputError(f"{type(self.residual).__name__}.nr of '{self.name}'", rows, "its number of entries")
        for field, _ in self.own:
            if np.isnan(numbers(f"{field} of '{self.name}'", getattr(self, field), (), (int(rows),))).any():
                raise InputError(f"{field} of '{self.name}'", "NaN", "numbers")
        for parameter in self.parameters():
            parameter.check_sign(np.asarray(parameter.default, dtype=np.float64))

    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters, called ``<name>_<parameter>``."""
        inner = (replace(p, name=f"{self.name}_{p.name}") for p in self.residual.parameters)
        fields = (
            Parameter(f"{self.name}_{key}", self.residual.nr, text, getattr(self, key), self.sign)
            for key, text in self.own
        )
        return (*inner, *fields)

    def _column(self, s: StageSymbols) -> tuple[StageSymbols, Any]:
        scoped = s.within(self.name)
        what = f"{type(self.residual).__name__}.expression of '{self.name}'"
        expected = f"a CasADi column of shape ({self.residual.nr}, 1) for its nr"
        try:
            column = self.residual.expression(scoped)
        except LgmpcError:
            raise
        except Exception as error:  # of any kind: CasADi's, or of the user's own code
            reason = str(error).splitlines()[-1] if str(error) else ""
            raise InputError(what, f"{type(error).__name__}: {reason}", expected) from error
        if not hasattr(column, "shape") or column.shape != (self.residual.nr, 1):
            got = f"shape {column.shape}" if hasattr(column, "shape") else type(column).__name__
            raise InputError(what, got, expected)
        return scoped, column


@dataclass(frozen=True, eq=False)
class CostItem(_Item):
    """A residual as a cost: ``sum_i weight_i a(r_i)``.

    At the last node it counts as the terminal cost if it is a function of the state alone.

    Attributes:
        name: a C identifier, first part of the names of its parameters.
        residual: r.
        weight: default of the parameter ``<name>_weight`` (nr,).
        activation: a; its fields are defaults of parameters too.

    Raises:
        InputError: a name that is no identifier, or a weight or field of the activation of the wrong size or sign.
    """

    weight: ArrayLike = 1.0
    activation: Activation = Quadratic()
    own = (("weight", "weights of the residual's entries"),)
    sign = "not negative"

    def __post_init__(self) -> None:
        if not isinstance(self.activation, Activation):
            got = type(self.activation).__name__
            raise InputError(f"activation of '{self.name}'", got, "an Activation, as lgmpc.costs.Huber()")
        super().__post_init__()

    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters, called ``<name>_<parameter>``."""
        return (*super().parameters(), *self.activation.parameters(self.name, self.residual.nr))

    def term(self, s: StageSymbols) -> CostTerm:
        """Return the cost at a node."""
        scoped, column = self._column(s)
        activation = self.activation.bind(self.name, scoped)
        return CostTerm(column, activation, scoped["weight"])


@dataclass(frozen=True, eq=False)
class ConstraintItem(_Item):
    """A residual as a hard constraint of the running nodes: ``lower <= r <= upper``.

    Attributes:
        name: a C identifier, first part of the names of its parameters.
        residual: r.
        lower: default of the parameter ``<name>_lower`` (nr,); minus infinity for no bound.
        upper: default of the parameter ``<name>_upper`` (nr,); infinity for no bound.

    Raises:
        InputError: a name that is no identifier, or bounds of the wrong size or in the wrong order.
    """

    lower: ArrayLike = 0.0
    upper: ArrayLike = 0.0
    own = (("lower", "lower bounds of the residual's entries"), ("upper", "upper bounds of the residual's entries"))

    def __post_init__(self) -> None:
        super().__post_init__()
        lower, upper = (
            np.broadcast_to(np.asarray(b, dtype=np.float64), self.residual.nr) for b in (self.lower, self.upper)
        )
        crossed = np.flatnonzero(lower > upper)
        if crossed.size:
            row = int(crossed[0])
            got = f"{lower[row]:g} in row {row}, above the upper bound {upper[row]:g}"
            raise InputError(f"lower of '{self.name}'", got, "a lower bound that is not above the upper")

    def bounded(self, s: StageSymbols) -> Bounded:
        """Return the constraint at a node."""
        scoped, column = self._column(s)
        return Bounded(column, scoped["lower"], scoped["upper"])


def cost_of(items: Iterable[CostItem], s: StageSymbols, *, scale: Any = 1.0, terminal: bool = False) -> Cost:
    """Return the sum of costs at a node.

    Args:
        items: the costs.
        s: the node.
        scale: multiplies all weights.
        terminal: omit those that use quantities that the last node does not have.
    """
    terms = []
    for item in items:
        try:
            term = item.term(s)
        except MissingQuantityError:
            if not terminal:
                raise
            continue
        terms.append(CostTerm(term.residual, term.activation, scale * ca.SX(term.weight)))
    return Cost(tuple(terms))


def constraint_of(items: Iterable[ConstraintItem], s: StageSymbols) -> Bounded:
    """Return all constraints at a node in one column."""
    return Bounded.stack(*(item.bounded(s) for item in items))
