"""Names of the slices of a parameter vector: all that may change between two solves."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.typing import Array, IntArray, identifier, instance, numbers

_SIGNS = ("any", "not negative", "positive")


@dataclass(frozen=True)
class Parameter:
    """One named entry of a parameter vector.

    Attributes:
        name: a Python identifier.
        size: number of values.
        meaning: description with the unit.
        default: its entries of :attr:`ParameterLayout.default`: (size,) values, or one part or a number for all.
        sign: values that it can have, besides its default: any, none below zero, or only those above zero.
        part: number of values that belong together, such as the gains of one contact; a value of this length is
            repeated for all parts.
    """

    name: str
    size: int
    meaning: str
    default: ArrayLike = 0.0
    sign: Literal["any", "not negative", "positive"] = "any"
    part: int = 1

    def __post_init__(self) -> None:
        """Raise for wrong types."""
        identifier("name", self.name)
        for name in ("size", "part"):
            instance(f"{name} of '{self.name}'", getattr(self, name), (int, np.integer), "a whole number")
        if self.size < 0 or self.part < 1:
            raise InputError(f"size, part of '{self.name}'", f"{self.size}, {self.part}", "at least 0 and 1")
        if str(self.sign) not in _SIGNS:
            raise InputError(f"sign of '{self.name}'", str(self.sign), "a sign", _SIGNS)
        numbers(self.name, self.default)

    def check_sign(self, values: Array, where: str = "") -> None:
        """Check values of the parameter.

        Args:
            values: any number of them.
            where: text behind the name in the message.

        Raises:
            InputError: one has a sign that the parameter cannot have.
        """
        least = float(values.min(initial=np.inf))
        if self.sign == "positive" and not least > 0.0:
            raise InputError(f"{self.name}{where}", least, f"numbers above zero ({self.meaning})")
        if self.sign == "not negative" and not least >= 0.0:
            raise InputError(f"{self.name}{where}", least, f"no number below zero ({self.meaning})")

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes that a value can have: a number, all values, or one part of them."""
        return ((), (self.size,), (self.part,)) if self.part > 1 else ((), (self.size,))

    def whole(self, values: Array) -> Array:
        """Return the values (size,), or a number, of a value in one of :attr:`shapes`."""
        if self.part == 1 or values.shape != (self.part,):
            return values
        return np.tile(values, self.size // self.part)


class ParameterLayout(Mapping[str, slice]):
    """Maps each parameter's name to its slice of the vector ``p`` (np,) that every function of an action takes.

    Args:
        parameters: in the order in which they are stored.

    Attributes:
        parameters: the same.
        size: np, the length of the vector.
        default: (np,) the parameters' defaults, read-only.

    Raises:
        InputError: two parameters of one name, or a default of the wrong size.
    """

    def __init__(self, *parameters: Parameter) -> None:
        for parameter in parameters:
            instance("parameters", parameter, Parameter, "a Parameter")
        self.parameters = parameters
        self._slices: dict[str, slice] = {}
        start = 0
        for parameter in parameters:
            if parameter.name in self._slices:
                raise InputError("parameters", f"two called '{parameter.name}'", "a name of its own for each")
            self._slices[parameter.name] = slice(start, start + parameter.size)
            start += parameter.size
        self.size = start
        self.default: Array = np.zeros(start)
        for parameter in parameters:
            values = numbers(f"default of {parameter.name}", parameter.default, *parameter.shapes)
            self.default[self._slices[parameter.name]] = parameter.whole(values)
        self.default.flags.writeable = False

    @cached_property
    def positive(self) -> IntArray:
        """Places of the values that must be above zero."""
        return self._places("positive")

    @cached_property
    def not_negative(self) -> IntArray:
        """Places of the values that must not be below zero."""
        return self._places("not negative")

    def _places(self, sign: str) -> IntArray:
        slices = [self._slices[each.name] for each in self.parameters if each.sign == sign]
        return np.concatenate([np.zeros(0, dtype=np.int64), *(np.arange(s.start, s.stop) for s in slices)])

    def structural_state(self) -> dict[str, Any]:
        """Return the attributes that expressions depend on (see :mod:`lgmpc.compile`): names and places, no values."""
        return {"_slices": self._slices, "size": self.size}

    def __getitem__(self, name: str) -> slice:
        """Return the slice of the vector where ``name`` is stored.

        Raises:
            InputError: there is no such parameter; names the nearest.
        """
        try:
            return self._slices[name]
        except (KeyError, TypeError):  # or a name that is no text
            raise InputError("parameter", str(name), "a parameter of the action", tuple(self._slices)) from None

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of this name.

        Raises:
            InputError: there is no such parameter; names the nearest.
        """
        place = self[name]
        return next(each for each in self.parameters if self._slices[each.name] is place)

    def __iter__(self) -> Iterator[str]:
        return iter(self._slices)

    def __len__(self) -> int:
        return len(self._slices)

    def split(self, p: Any) -> dict[str, Any]:
        """Return the named slices of a CasADi column or of an array (np,)."""
        return {name: p[where] for name, where in self._slices.items()}

    def view(self, p: Array, name: str) -> Array:
        """Return a writable view (..., size) of one parameter in an array (..., np) of parameter vectors."""
        instance("p", p, np.ndarray, "an array (..., np)")
        return p[..., self[name]]
