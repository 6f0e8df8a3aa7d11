"""The document of a sweep: base configs, variations, and the data kept of each run."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union

from pydantic import BeforeValidator, Field, model_validator

from lgmpc.runs import Gate
from lgmpc.settings import (
    Finite,
    Fraction,
    NonNegative,
    Positive,
    Problem,
    Range,
    RangeFromZero,
    Settings,
    key,
    problem,
    problems,
)

Number = Annotated[int, Field(strict=True, ge=0, lt=2**31)]
Points = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]


Keys = Annotated[
    tuple[str, ...], Field(min_length=1), BeforeValidator(lambda value: (value,) if isinstance(value, str) else value)
]
"""A dotted key of the base config, or a list of keys that all get the same value."""


class _Factor(Settings):
    """A key, or several that get the same value."""

    key: Keys = Field(description="Dotted key of the base config, or a list of keys that all get the same value.")


class Values(_Factor):
    """A list of values, each combined with each of the other factors'."""

    kind: Literal["values"] = Field(description="A list of values.")
    values: tuple[Any, ...] = Field(min_length=1, description="The values.")


class Directions(_Factor):
    """Evenly spaced horizontal vectors around the circle."""

    kind: Literal["directions"] = Field(description="Horizontal vectors [x, y, 0] around the circle.")
    count: Points = Field(description="Number of vectors.")
    size: Positive = key(1.0, "Length of the vectors, in the unit of the key.")
    start_deg: Finite = key(0.0, "Angle of the first vector from the x axis, degrees.")


class Uniform(_Factor):
    """Numbers of a uniform distribution, or numbers whose logarithms have one."""

    kind: Literal["uniform", "log_uniform"] = Field(
        description="uniform: uniformly distributed numbers; log_uniform: numbers whose logarithms are."
    )
    range: Range = Field(description="[lowest, highest]; above zero for log_uniform.")

    @model_validator(mode="after")
    def _positive(self) -> "Uniform":
        if self.kind == "log_uniform" and self.range[0] <= 0.0:
            raise problem("[lowest, highest] above zero", key="range", got=self.range)
        return self


class Normal(_Factor):
    """Numbers of a normal distribution."""

    kind: Literal["normal"] = Field(description="Normally distributed numbers.")
    mean: Finite = Field(description="Mean.")
    std: Positive = Field(description="Standard deviation.")


class Choice(_Factor):
    """One of several values, each as probable as the others."""

    kind: Literal["choice"] = Field(description="One of several values.")
    values: tuple[Any, ...] = Field(min_length=1, description="The values.")


class Horizontal(_Factor):
    """Horizontal vectors [x, y, 0] of uniformly distributed direction and length."""

    kind: Literal["horizontal"] = Field(description="Horizontal vectors of random direction and length.")
    range: RangeFromZero = Field(description="[shortest, longest], in the unit of the key.")


Factor = Annotated[Union[Values, Directions], Field(discriminator="kind")]  # noqa: UP007
_Any = Union[Uniform, Normal, Choice, Horizontal]  # noqa: UP007
Distribution = Annotated[_Any, Field(discriminator="kind")]


class Samples(Settings):
    """Random draws of several keys at once. Every draw gets a seed of its own as key ``seed``."""

    count: Points = Field(description="Number of draws.")
    seed: Number = key(0, "Seed of the draws; draw i runs with seed + i.")
    method: Literal["random", "latin_hypercube"] = key(
        "random",
        "random: independent draws. latin_hypercube: each key's distribution is cut into `count` parts of "
        "equal probability, and each part is drawn from once.",
    )
    keys: Annotated[tuple[Distribution, ...], Field(min_length=1)] = Field(description="Distributions to draw from.")


class BisectionSettings(Settings):
    """Search of the largest value of one key at which a run still passes.

    The verdict is assumed monotonic: a run that passes at a value passes at every smaller one.
    """

    key: str = Field(min_length=1, description="Dotted key. If it is a vector, the value scales that vector.")
    range: Range = Field(description="[passes, fails]: a value at which a run passes, and one at which it fails.")
    tolerance: Positive = Field(description="Width of the final interval around the boundary.")

    @model_validator(mode="after")
    def _finds_something(self) -> "BisectionSettings":
        if self.tolerance >= self.range[1] - self.range[0]:
            raise problem("less than the width of the range", key="tolerance", got=self.tolerance)
        return self


class LogChoice(Settings):
    """Selection of the run folders to keep."""

    keep: Number = key(10, "Largest number of run folders: failures first, the earliest of them.")


class Expectation(Settings):
    """Limits on the figures of the sweep; a point that raises, hangs or ends its process fails every sweep."""

    min_pass_fraction: Fraction | None = key(None, "Smallest share of points that pass, 0 to 1.")
    min_boundary: NonNegative | None = key(None, "Smallest boundary that a bisection may find.")


class SweepSettings(Settings):
    """A sweep: every base with every variant at every combination of the factors and every draw."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=80,
        description="Name of the sweep; that of its folder, so letters, digits, '.', '_' and '-' only.",
    )
    base: Keys = Field(description="A config of a closed loop (file, or name of a shipped one), or a list of them.")
    set: Mapping[str, Any] = key({}, "Changes of the base configs, for all points.")
    factors: tuple[Factor, ...] = key((), "Factors, varied in all combinations.")
    samples: Samples | None = key(None, "Random draws, at every combination.")
    variants: Mapping[str, Mapping[str, Any]] = key(
        {}, "Named changes, each run at all the same points with the same seeds: compared in pairs."
    )
    paired: bool = Field(
        default=True,
        strict=True,
        description="Whether the variants are compared with the first one, in pairs: not useful for different robots.",
    )
    bisect: BisectionSettings | None = key(None, "A boundary that is searched at every point.")
    gate: Gate | None = key(None, "Criteria of success; they replace those of the bases.")
    metrics: tuple[str, ...] | None = key(None, "Metrics to keep (see metrics of a run.json); all if not given.")
    expect: Expectation = key(Expectation(), "Criteria of success of the sweep.")
    logs: LogChoice = key(LogChoice(), "Run folders to keep.")
    time_limit_s: Positive = key(900.0, "Longest time that a point may compute, s.")
    memory_limit_gb: Positive = key(8.0, "Memory that a worker process may allocate, GB; a point beyond it fails.")

    @model_validator(mode="after")
    def _varies_each_key_once(self) -> "SweepSettings":
        draws = self.samples.keys if self.samples else ()
        varied = [
            *((f"factors.{i}.key", key) for i, factor in enumerate(self.factors) for key in factor.key),
            *((f"samples.keys.{i}.key", key) for i, draw in enumerate(draws) for key in draw.key),
        ]
        found = [
            Problem(place, key, "a key that no other factor varies")
            for position, (place, key) in enumerate(varied)
            if key in [other for _, other in varied[:position]]
        ]
        found += [
            Problem(f"variants.{name}.{key}", key, "a key that no factor varies")
            for name, changes in self.variants.items()
            for key in changes
            if key in [other for _, other in varied]
        ]
        if not (self.factors or self.samples or self.variants or self.bisect or len(self.base) > 1):
            found.append(Problem("factors", [], "a variation: factors, samples, variants, bisect or several bases"))
        if found:
            raise problems(found)
        return self
