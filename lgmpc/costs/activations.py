"""Activations: the cost of a residual, one scalar function applied to each of its entries.

An activation is a frozen dataclass whose fields are its parameters: numbers, arrays, or CasADi expressions, either one
for all entries or a column with one for each. In a :class:`~lgmpc.costs.CostItem` they become named parameters of the
compiled functions, which can be changed without recompilation.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from lgmpc.costs.parameters import Parameter
from lgmpc.errors import InputError
from lgmpc.typing import numbers


@dataclass(frozen=True, eq=False)
class Activation(ABC):
    """A scalar function of one residual entry, with its derivatives; all methods act on the entries of a column.

    Attributes:
        sign: values that the fields can have; see :class:`~lgmpc.costs.Parameter`.
    """

    sign: ClassVar[Literal["any", "not negative", "positive"]] = "any"

    @abstractmethod
    def value(self, r: Any) -> Any:
        """Return ``a(r)``."""

    @abstractmethod
    def gradient(self, r: Any) -> Any:
        """Return ``a'(r)``."""

    @abstractmethod
    def curvature(self, r: Any) -> Any:
        """Return ``a''(r)``, not negative."""

    def parameters(self, prefix: str, size: int) -> tuple[Parameter, ...]:
        """Return the fields as parameters ``<prefix>_<field>`` for a residual of ``size`` entries.

        Raises:
            InputError: a field has the wrong number of values.
        """
        found = []
        for field in fields(self):
            name = f"{prefix}_{field.name}"
            values = numbers(name, getattr(self, field.name), (), (size,))
            meaning = f"{field.name} of the {type(self).__name__} activation"
            found.append(Parameter(name, size, meaning, values, self.sign))
        return tuple(found)

    def bind(self, prefix: str, values: Any) -> "Activation":
        """Return the same activation with its fields taken from a mapping of ``<prefix>_<field>`` to columns."""
        return replace(self, **{field.name: values[f"{prefix}_{field.name}"] for field in fields(self)})


@dataclass(frozen=True, eq=False)
class Quadratic(Activation):
    """``a = r^2 / 2``."""

    def value(self, r: Any) -> Any:
        """Return half the square."""
        return r**2 / 2

    def gradient(self, r: Any) -> Any:
        """Return r."""
        return r

    def curvature(self, r: Any) -> Any:
        """Return one."""
        return type(r).ones(*r.shape)


@dataclass(frozen=True, eq=False)
class QuadraticBarrier(Activation):
    """Half the squared distance from an interval: zero within ``[lower, upper]``.

    Attributes:
        lower: lower end; minus infinity for none.
        upper: upper end; infinity for none.
    """

    lower: Any
    upper: Any

    def parameters(self, prefix: str, size: int) -> tuple[Parameter, ...]:
        """Return the ends as parameters; see :meth:`Activation.parameters`.

        Raises:
            InputError: a field has the wrong number of values, or a lower end is above the upper one.
        """
        found = super().parameters(prefix, size)
        if (np.asarray(found[0].default) > np.asarray(found[1].default)).any():
            got = f"{found[0].default} with {prefix}_upper {found[1].default}"
            raise InputError(f"{prefix}_lower", got, "a lower end that is not above the upper")
        return found

    def value(self, r: Any) -> Any:
        """Return half the squared distance."""
        return self.gradient(r) ** 2 / 2

    def gradient(self, r: Any) -> Any:
        """Return the signed distance."""
        return ca.if_else(r < self.lower, r - self.lower, 0) + ca.if_else(r > self.upper, r - self.upper, 0)

    def curvature(self, r: Any) -> Any:
        """Return one outside, zero within."""
        return ca.if_else(r < self.lower, 1.0, 0) + ca.if_else(r > self.upper, 1.0, 0)


@dataclass(frozen=True, eq=False)
class Huber(Activation):
    """``r^2 / 2`` up to the threshold d, then the line ``d |r| - d^2 / 2``. Huber, Ann. Math. Statist. 35 (1964).

    Attributes:
        threshold: d, positive.
    """

    threshold: Any = 1.0
    sign = "positive"

    def value(self, r: Any) -> Any:
        """Return half the square up to the threshold, the line beyond."""
        d = self.threshold
        return ca.if_else(ca.fabs(r) <= d, r**2 / 2, d * (ca.fabs(r) - d / 2))

    def gradient(self, r: Any) -> Any:
        """Return r, cut off at the threshold."""
        d = self.threshold
        return ca.if_else(ca.fabs(r) <= d, r, ca.sign(r) * d)

    def curvature(self, r: Any) -> Any:
        """Return one up to the threshold, zero beyond."""
        return ca.if_else(ca.fabs(r) <= self.threshold, 1.0, 0.0)
