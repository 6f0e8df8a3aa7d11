"""``run.json``: the result and the machine of a run, in two kinds: closed loops and solved problems."""

import functools
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from pydantic import TypeAdapter, ValidationError

from lgmpc.errors import RunFolderError
from lgmpc.runs.atomic import Number, json_values
from lgmpc.runs.certificate import Certificate
from lgmpc.runs.figures import figure_number, figure_of, figure_words
from lgmpc.runs.gate import Verdict, measured
from lgmpc.runs.metrics import Metrics, flat_metrics

_SHOWN = ("survived_s", "max_tilt_deg", "max_displacement_m", "max_slip_m", "max_abs_torque_nm", "real_time_factor")
"""Metrics of a closed loop that its text has."""

_PACKAGES = ("lgmpc", "pin", "casadi", "mujoco", "proxsuite", "osqp", "piqp", "numpy", "example-robot-data")

SCHEMA = 1
"""Version of the folder's format; newer ones are refused."""

RESULT_FILE = "run.json"

R = TypeVar("R", bound="_Result")
Values = Mapping[str, tuple[Any, Any]]
"""Values before and after by dotted key."""


@dataclass(frozen=True)
class HostInfo:
    """Properties of the machine.

    Attributes:
        system: operating system and its release.
        machine: architecture.
        cpu: processor's name, as the system reports it.
        cores: processors that this process may use.
        threads: the thread cap of numerical libraries (OMP_NUM_THREADS), empty if not set.
    """

    system: str
    machine: str
    cpu: str
    cores: int
    threads: str


def host_info() -> HostInfo:
    """Return the properties of this machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    system, threads = f"{platform.system()} {platform.release()}", os.environ.get("OMP_NUM_THREADS", "")
    return HostInfo(system, platform.machine(), _cpu_name(), cores, threads)


def _cpu_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor()


def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages on which results depend ("absent" if not installed)."""
    return {"python": platform.python_version(), **{package: _version_of(package) for package in _PACKAGES}}


@functools.cache  # reading a package's metadata takes milliseconds, and every point of a sweep has the versions
def _version_of(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "absent"


@dataclass(frozen=True)
class SettingsChange:
    """A change of settings during a run.

    Attributes:
        time_s: time from which they act, s.
        values: values before and after by key.
    """

    time_s: float
    values: Values

    @property
    def differences(self) -> str:
        """The changes in words: ``key before -> after``."""
        return ", ".join(f"{key} {before} -> {after}" for key, (before, after) in self.values.items())


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


@dataclass(frozen=True, repr=False)
class _Result:
    """The common entries of both kinds.

    Attributes:
        name: the run's name.
        verdict: pass, fail or interrupted, with reasons.
        created: time of creation, UTC, ISO 8601.
        versions: versions of Python and packages.
        host: the machine.
    """

    kind: ClassVar[str]

    name: str
    verdict: Verdict
    created: str = field(default_factory=_now, kw_only=True)
    versions: Mapping[str, str] = field(default_factory=versions, kw_only=True)
    host: HostInfo = field(default_factory=host_info, kw_only=True)

    @property
    def when(self) -> str:
        """Time of creation as text: ``2026-03-01 12:00:00 UTC``."""
        return self.created.replace("T", " ").replace("+00:00", " UTC")

    def __repr__(self) -> str:
        figures = (figure_words(name, value) + (value,) for name, value in self.shown().items())
        texts = [
            f"{words} {figure_number(scale * value, unit)} {unit}".rstrip() for words, unit, scale, value in figures
        ]
        reasons = "".join(f"\n  - {reason}" for reason in self.verdict.reasons)
        return f"<{self.verdict.outcome.value.upper()} {self.name}: {', '.join(texts)}>{reasons}"

    if TYPE_CHECKING:  # a field of the one, a property of the other

        @property
        def figures(self) -> Mapping[str, float | None]:
            """All figures by their names."""

        @property
        def about(self) -> str:
            """Origin of the figures: the seed, or the solver and its ending."""

    def at_limit(self, limit: str) -> float | None:
        """Return the figure of a limit (``max_<figure>`` or ``min_<figure>``); ``None`` if it was not measured."""
        return self.figures.get(figure_of(limit))

    def limited(self, limits: Mapping[str, float]) -> list[tuple[str, float | None, float]]:
        """Return the key, the figure and the limit of each of a gate's limits."""
        return [(key, self.at_limit(key), limit) for key, limit in limits.items()]

    def shown(self) -> dict[str, float]:
        """Return the figures that the text has."""
        return {name: value for name, value in self.figures.items() if value is not None}

    def to_json(self) -> str:
        """Return the text of ``run.json``."""
        own = {"schema": SCHEMA, "kind": self.kind} | self._content()
        own |= {"verdict": self.verdict.outcome, "reasons": self.verdict.reasons}
        first, last = ("schema", "kind", "name", "created", "verdict", "reasons"), ("versions", "host")
        between = (name for name in own if name not in first + last)
        content = {name: own[name] for name in (*first, *between, *last)}
        return json.dumps(json_values(content), indent=2, allow_nan=False) + "\n"

    def _content(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls: type[R], text: str, source: str = RESULT_FILE) -> R:
        """Return the result of a ``run.json``; ``source`` names it in errors.

        Raises:
            RunFolderError: if it is not JSON, of a newer schema, of the other kind, or lacks an entry.
        """
        content = _parsed(text, source)
        kind = content.get("kind")
        if kind != cls.kind:
            raise RunFolderError(f"{source} is of a {_words(kind)}, not of a {_words(cls.kind)}")
        content["verdict"] = {"outcome": content.get("verdict"), "reasons": content.get("reasons", ())}
        if cls is RunResult and "seed" not in content:
            raise RunFolderError(f"{source} is damaged: no seed")
        try:
            result: R = _reader(cls.kind).validate_json(json.dumps(content), strict=True)
            result.shown()
        except (ValidationError, OverflowError) as error:
            raise RunFolderError(f"{source} is damaged: {_first(error)}") from error
        return result


@functools.cache
def _reader(kind: str) -> Any:
    return TypeAdapter(RunResult if kind == RunResult.kind else SolveResult)


def _first(error: Exception) -> str:
    """Return the place and the message of the first of the errors of a validation."""
    if not isinstance(error, ValidationError):
        return str(error)
    found = error.errors(include_url=False, include_context=False)[0]
    return f"{'.'.join(map(str, found['loc']))}: {found['msg']}, got {str(found['input'])[:40]}"


@dataclass(frozen=True, repr=False)
class RunResult(_Result):
    """The ``run.json`` of a closed loop.

    Attributes (besides the common ones):
        metrics: of the run; ``None`` if it stopped before its first tick.
        seed: seed of the run's random numbers.
        certificate: checks of physics and hardware; ``None`` of robots, and of too short runs.
        changes: of settings during the run.
    """

    kind: ClassVar[str] = "closed_loop"

    metrics: Metrics | None
    seed: int = 0
    certificate: Certificate | None = None
    changes: tuple[SettingsChange, ...] = ()

    @property
    def figures(self) -> Mapping[str, float | None]:
        """All metrics by their names."""
        return {} if self.metrics is None else flat_metrics(self.metrics)

    @property
    def about(self) -> str:
        """The seed in words."""
        return f"seed {self.seed}"

    def at_limit(self, limit: str) -> float | None:
        """Return the metric of a limit of the gate; ``None`` if it was not measured."""
        return None if self.metrics is None else measured(self.metrics, limit)

    def shown(self) -> dict[str, float]:
        """Return a few metrics."""
        values = super().shown()
        return {name: values[name] for name in _SHOWN if name in values}

    def _content(self) -> dict[str, Any]:
        content = asdict(self) | {"certificate": None if self.certificate is None else self.certificate.content()}
        changes = content.pop("changes")
        return content | ({"changes": changes} if changes else {})


@dataclass(frozen=True, repr=False)
class SolveResult(_Result):
    """The ``run.json`` of a solved problem.

    Attributes (besides the common ones):
        method: the solver.
        status: the name of the :class:`lgmpc.solvers.Status`, in lower case.
        explanation: why it did not converge, in a few lines, and the problem's remarks on the solution.
        figures: by name, which ends in the unit; NaN where one could not be measured.
    """

    kind: ClassVar[str] = "solve"

    method: str
    status: str
    explanation: str
    figures: Mapping[str, Number]

    @property
    def about(self) -> str:
        """The solver and its ending in words."""
        return f"{self.method}: {self.status.replace('_', ' ')}"


def kind_of(text: str, source: str = RESULT_FILE) -> str:
    """Return the kind of run (``closed_loop``, ``solve``) whose ``run.json`` has this text.

    Raises:
        RunFolderError: if it is not JSON, or of a newer schema.
    """
    return str(_parsed(text, source).get("kind"))


def _parsed(text: str, source: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise RunFolderError(f"{source} is not JSON: {error}") from error
    if not isinstance(content, dict) or not isinstance(content.get("schema"), int):
        raise RunFolderError(f"{source} has no schema number: not a run of lgmpc")
    if content["schema"] > SCHEMA:
        raise RunFolderError(f"{source} has schema {content['schema']}, this lgmpc reads up to {SCHEMA}: update lgmpc")
    return content


def _words(kind: object) -> str:
    return {"closed_loop": "closed loop", "solve": "solved problem"}.get(str(kind), f"kind unknown here ({kind})")
