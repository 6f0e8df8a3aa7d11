"""The base of all settings classes: strict and frozen, with types of bounded numbers and errors that name the key.

Each package defines its settings as subclasses of :class:`Settings`: units in the names; bounds, defaults and
descriptions in the fields. Python code constructs them directly; a config document composes the same classes.
"""

import functools
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Tag,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic._internal._model_construction import ModelMetaclass
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError
from typing_extensions import Self

from lgmpc.settings.dotted import write_at

_T = TypeVar("_T")

PROBLEM = "lgmpc"
"""The pydantic error type of all errors of :func:`problems`."""


class _SettingsType(ModelMetaclass):
    """Raises pydantic's first error of a construction as an InputError; a config reports all of them."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        try:
            return super().__call__(*args, **kwargs)
        except ValidationError as error:
            from lgmpc.settings.messages import first_input_error

            raise first_input_error(error, cast("type[Settings]", cls), kwargs) from error


class Settings(BaseModel, metaclass=_SettingsType):
    """Checked values: unknown keys are errors, values cannot be changed after they were checked.

    Raises:
        InputError: by the constructor, for the first key that is unknown, missing or cannot be used.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, hide_input_in_errors=True)

    @model_validator(mode="before")
    @classmethod
    def _take_numpy(cls, data: Any) -> Any:
        """Return the values with numpy's numbers and arrays as Python's."""
        if not isinstance(data, Mapping):
            return data
        return {key: value.tolist() if hasattr(value, "tolist") else value for key, value in data.items()}

    def structural_state(self) -> dict[str, Any]:
        """Return the values (see :mod:`lgmpc.compile`), whether they were given or are defaults."""
        private: dict[str, Any] = {
            "__pydantic_fields_set__": set(),
            "__pydantic_extra__": None,
            "__pydantic_private__": None,
        }
        return {**vars(self), **private}

    def replace(self, changes: Mapping[str, Any]) -> Self:
        """Return a checked copy with some values changed.

        Values that were not given keep their defaults: a change of the key that selects a variant (``mpc.model``)
        selects that variant's defaults.

        Args:
            changes: dotted key to value, such as ``{"weights.com": (1e3, 1e3, 1e3)}``; list positions count from 0,
                and the one after the last appends.

        Raises:
            InputError: a key that does not exist or a value that cannot be used.
        """
        data, whole = self._given(), self.model_dump()
        for key, value in changes.items():
            write_at(data, key, value, whole)
        return type(self)(**data)

    def value(self, key: str) -> Any:
        """Return the value at a dotted key; ``None`` for one that a table of any keys lacks.

        Raises:
            InputError: no such key; names the nearest.
        """
        here: Any = self
        for part in key.split("."):
            try:
                if isinstance(here, Settings):
                    here = getattr(here, part)
                else:
                    here = here[part if isinstance(here, Mapping) else int(part)]
            except (AttributeError, LookupError, TypeError, ValueError):
                self.replace({key: None})  # raises, and names the nearest key
                return None
        return here

    def __repr__(self) -> str:
        """Return the values that are not their defaults, shortened."""
        text = f"{type(self).__name__}({', '.join(f'{key}={_short(value)}' for key, value in self._changed())})"
        return textwrap.fill(text, 120, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)

    __str__ = __repr__

    def _changed(self, section: str = "") -> Iterator[tuple[str, Any]]:
        """Yield dotted key and value of each entry that differs from its default, nested settings included."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            default = None if field.is_required() else field.get_default(call_default_factory=True, validated_data={})
            if not field.is_required() and value == default:
                continue
            if isinstance(value, Settings) and (field.is_required() or type(value) is type(default)):
                yield from value._changed(f"{section}{name}.")
            else:
                yield f"{section}{name}", value

    def _given(self) -> dict[str, Any]:
        """Return the values that were given, nested settings included, and those that select the variants of unions."""
        data: dict[str, Any] = dict(self.model_extra or {})
        selecting = _selecting(type(self))
        for name in type(self).model_fields:
            value = getattr(self, name)
            if isinstance(value, Settings):
                data[name] = value._given()
            elif name in selecting or name in self.model_fields_set:
                data[name] = (
                    [each._given() if isinstance(each, Settings) else each for each in value]
                    if isinstance(value, tuple)
                    else value
                )
        return data


@functools.cache
def _selecting(kind: type[Settings]) -> frozenset[str]:
    """Return the names of the values that select this variant of a union: there is one choice."""
    return frozenset(
        name
        for name, field in kind.model_fields.items()
        if get_origin(field.annotation) is Literal and len(get_args(field.annotation)) == 1
    )


def _short(value: Any) -> str:
    """Return a value as a cell of a table, lists of settings by their number."""
    if isinstance(value, tuple) and any(isinstance(each, Settings) for each in value):
        return f"{len(value)} {'entry' if len(value) == 1 else 'entries'}"
    text = str(list(value)) if isinstance(value, tuple) else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def key(default: _T, description: str) -> _T:
    """Return the field of a key; keys that are required, or have bounds of their own, are pydantic's ``Field``."""
    return Field(default=default, description=description)


def one_of(kinds: Mapping[str, type[Settings]], name: str) -> Any:
    """Return the type of settings of one of ``kinds``, which their key ``name`` selects; the first by default."""
    first = next(iter(kinds))

    def selected(value: Any) -> Any:
        return value.get(name, first) if isinstance(value, Mapping) else getattr(value, name, first)

    tagged = tuple(Annotated[kind, Tag(each)] for each, kind in kinds.items())
    return Annotated[Union[tagged], Discriminator(selected)]  # noqa: UP007


class Words(str):
    """A value in words, as a message shows it."""


class Extension(Settings):
    """A class or a function of one's own, named in a config. In place of the table its name suffices."""

    use: str = Field(
        description="module:name, such as my_module:HandTask; the module is beside the config, in the working folder or"
        " installed."
    )
    arguments: dict[str, Any] = key({}, "Its keyword arguments.")

    @model_validator(mode="before")
    @classmethod
    def _take_name(cls, data: Any) -> Any:
        return {"use": data} if isinstance(data, str) else data

    @field_validator("use")
    @classmethod
    def _check_name(cls, value: str) -> str:
        module, colon, name = value.partition(":")
        if not colon or not name.isidentifier() or not all(part.isidentifier() for part in module.split(".")):
            raise problem("module:name, such as my_module:HandTask")
        return value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return a schema that allows the name alone."""
        return {"anyOf": [{"type": "string"}, handler(core)]}


@dataclass(frozen=True)
class Problem:
    """One key that cannot be used.

    Attributes:
        key: dotted path below the validated section; empty for the validated value itself.
        got: the value of that key; not used where ``key`` is empty.
        expected: the values accepted, in words.
    """

    key: str
    got: Any
    expected: str


def problems(found: Sequence[Problem]) -> PydanticCustomError:
    """Return the error by which a validator reports several problems."""
    return PydanticCustomError(PROBLEM, "cannot be used", {"problems": tuple(found)})


def problem(expected: str, key: str = "", got: Any = None) -> PydanticCustomError:
    """Return the error by which a validator reports one problem; arguments as in :class:`Problem`."""
    return problems([Problem(key, got, expected)])


_LONGEST = 80
"""Characters of a value that a notebook displays."""

LARGEST = 1e9
"""Largest number of a config: larger ones overflow."""

Finite = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
"""A finite number."""
Positive = Annotated[float, Field(strict=True, gt=0.0, le=LARGEST, allow_inf_nan=False)]
"""A finite number above zero."""
NonNegative = Annotated[float, Field(strict=True, ge=0.0, le=LARGEST, allow_inf_nan=False)]
"""A finite number, zero or above."""
Noise = Annotated[float, Field(strict=True, ge=0.0, le=10.0, allow_inf_nan=False)]
"""A standard deviation or density of a sensor's noise, from 0 to 10."""
Friction = Annotated[float, Field(strict=True, gt=0.0, le=10.0, allow_inf_nan=False)]
"""A coefficient of Coulomb friction, above 0, at most 10."""
Interval = Annotated[float, Field(strict=True, ge=1e-4, le=10.0, allow_inf_nan=False)]
"""Length of an interval of an optimal control problem, s: 0.1 ms, a tenth of a control tick, to 10 s."""
Fraction = Annotated[float, Field(strict=True, ge=0.0, le=1.0, allow_inf_nan=False)]
"""A number from 0 to 1."""
Count = Annotated[int, Field(strict=True, ge=1, le=10_000)]
"""A whole number from 1 to 10000."""


def _need_list(length: int, words: str) -> BeforeValidator:
    def check(value: Any) -> Any:
        if not isinstance(value, (list, tuple)) or len(value) != length:
            raise problem(f"a list of {words}")
        return value

    return BeforeValidator(check)


def _check_order(value: Any) -> Any:
    if all(isinstance(v, (int, float)) for v in value) and value[0] >= value[1]:
        raise problem("[lowest, highest] with lowest below highest")
    return value


Vector2 = Annotated[tuple[Finite, Finite], _need_list(2, "two numbers [x, y]")]
"""Two finite numbers."""
Vector3 = Annotated[tuple[Finite, Finite, Finite], _need_list(3, "three numbers [x, y, z]")]
"""Three finite numbers, world axes."""
Range = Annotated[tuple[Finite, Finite], BeforeValidator(_check_order), _need_list(2, "two numbers [lowest, highest]")]
"""Two finite numbers, the lower one first."""
RangeFromZero = Annotated[
    tuple[NonNegative, Positive], BeforeValidator(_check_order), _need_list(2, "two numbers [lowest, highest]")
]
"""Two numbers, zero or above, the lower one first."""


PerJoint = Annotated[
    Union[Annotated[_T, Tag("number")], Annotated[dict[str, _T], Tag("table")]],  # noqa: UP007
    Discriminator(lambda value: "table" if isinstance(value, Mapping) else "number"),
]
"""``PerJoint[Positive]``: one number for all joints, or ``{joint name or pattern: number}``."""
PerJointRange = PerJoint[Range]
"""One ``[lowest, highest]`` for all joints, or ``{joint name or pattern: [lowest, highest]}``."""
