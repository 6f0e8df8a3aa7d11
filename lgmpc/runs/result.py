"""``run.json``: the result and the machine of a run, in two kinds: closed loops and solved problems."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields
from datetime import datetime, timezone
from typing import Any, ClassVar, TypeVar

from lgmpc.errors import RunFolderError
from lgmpc.notebook import html_table
from lgmpc.runs.atomic import json_values
from lgmpc.runs.certificate import Certificate
from lgmpc.runs.estimate import EstimatorErrors, SensorFaults
from lgmpc.runs.figures import figure_number, figure_words
from lgmpc.runs.host import HostInfo, host_info, versions
from lgmpc.runs.metrics import Metrics, Timing
from lgmpc.runs.modes import ModeMetrics
from lgmpc.runs.origin import Origin, SettingsChange
from lgmpc.runs.verdict import Outcome, Verdict
from lgmpc.runs.walking import WalkingMetrics

__all__ = ["RESULT_FILE", "SCHEMA", "RunResult", "SolveResult", "kind_of"]

_SHOWN = ("survived_s", "max_tilt_deg", "max_displacement_m", "max_slip_m", "max_abs_torque_nm", "real_time_factor")
"""Metrics of a closed loop that a notebook displays."""

SCHEMA = 1
"""Version of the folder's format; newer ones are refused."""

RESULT_FILE = "run.json"

R = TypeVar("R", bound="_Result")


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


@dataclass(frozen=True)
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

    def _repr_html_(self) -> str:
        """Return a table of the verdict and of some figures."""
        return self.html()

    def html(self, folder: object = None) -> str:
        """Return the table of verdict and figures, with the run's folder if it is given."""
        rows: list[tuple[str, object]] = [("verdict", self.verdict.outcome.value.upper())]
        rows += [("because", reason) for reason in self.verdict.reasons]
        rows += [figure_cells(name, value) for name, value in self.shown().items()]
        return html_table(self.name, [*rows, *([("folder", folder)] if folder is not None else [])])

    def shown(self) -> dict[str, float]:
        """Return the figures that the table displays."""
        raise NotImplementedError

    def to_json(self) -> str:
        """Return the text of ``run.json``."""
        content = {
            "schema": SCHEMA,
            "kind": self.kind,
            "name": self.name,
            "created": self.created,
            "verdict": self.verdict.outcome.value,
            "reasons": list(self.verdict.reasons),
            **self._own(),
            "versions": dict(self.versions),
            "host": asdict(self.host),
        }
        return json.dumps(content, indent=2, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls: type[R], text: str, source: str = RESULT_FILE) -> R:
        """Return the result of a ``run.json``; ``source`` names it in errors.

        Raises:
            RunFolderError: if it is not JSON, of a newer schema, of the other kind, or lacks an entry.
        """
        content = _content(text, source)
        kind = content.get("kind", RunResult.kind)
        if kind != cls.kind:
            raise RunFolderError(f"{source} is of a {_words(kind)}, not of a {_words(cls.kind)}")
        try:
            common: dict[str, Any] = {name: str(content[name]) for name in ("name", "created")}
            common["versions"] = dict(content["versions"])
            common["verdict"] = Verdict(Outcome(content["verdict"]), tuple(map(str, content["reasons"])))
            common["host"] = HostInfo(**content["host"])
            return cls._read(content, common)
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise RunFolderError(f"{source} is damaged: {type(error).__name__} {error}") from error

    def _own(self) -> dict[str, Any]:
        raise NotImplementedError

    @classmethod
    def _read(cls: type[R], content: Mapping[str, Any], common: dict[str, Any]) -> R:
        raise NotImplementedError


@dataclass(frozen=True)
class RunResult(_Result):
    """The ``run.json`` of a closed loop.

    Attributes (besides the common ones):
        metrics: of the run; ``None`` if it stopped before its first tick.
        seed: seed of the run's random numbers.
        certificate: checks of physics and hardware; ``None`` in older files.
        origin: the run that it continues; ``None`` if it began by itself.
        changes: of settings during the run.
    """

    kind: ClassVar[str] = "closed_loop"

    metrics: Metrics | None
    seed: int = 0
    certificate: Certificate | None = None
    origin: Origin | None = None
    changes: tuple[SettingsChange, ...] = ()

    def shown(self) -> dict[str, float]:
        """Return a few metrics."""
        values = {name: getattr(self.metrics, name, None) for name in _SHOWN}
        return {name: value for name, value in values.items() if value is not None}

    def _own(self) -> dict[str, Any]:
        metrics = None if self.metrics is None else json_values(asdict(self.metrics))
        certificate = None if self.certificate is None else self.certificate.content()
        origin = {} if self.origin is None else {"from": self.origin.content()}
        changes = {"changes": [each.content() for each in self.changes]} if self.changes else {}
        return {"seed": self.seed, **origin, **changes, "metrics": metrics, "certificate": certificate}

    @classmethod
    def _read(cls, content: Mapping[str, Any], common: dict[str, Any]) -> RunResult:
        given = content.get("certificate")
        certificate = None if given is None else Certificate.of(given)
        origin = Origin.of(content["from"]) if "from" in content else None
        changes = tuple(map(SettingsChange.of, content.get("changes", ())))
        own: dict[str, Any] = {"certificate": certificate, "origin": origin, "changes": changes}
        return cls(**common, seed=content["seed"], metrics=_metrics(content["metrics"]), **own)


@dataclass(frozen=True)
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
    figures: Mapping[str, float]

    def shown(self) -> dict[str, float]:
        """Return all figures."""
        return dict(self.figures)

    def _own(self) -> dict[str, Any]:
        figures = json_values(self.figures)
        return {"method": self.method, "status": self.status, "explanation": self.explanation, "figures": figures}

    @classmethod
    def _read(cls, content: Mapping[str, Any], common: dict[str, Any]) -> SolveResult:
        figures = {name: math.nan if value is None else float(value) for name, value in content["figures"].items()}
        texts: dict[str, Any] = {name: str(content[name]) for name in ("method", "status", "explanation")}
        return cls(**common, **texts, figures=figures)


def figure_cells(name: str, value: float) -> tuple[str, str]:
    """Return name and value of a figure as a table displays them."""
    words, unit, scale = figure_words(name, value)
    return (f"{words} / {unit}" if unit else words), figure_number(scale * value, unit)


def kind_of(text: str, source: str = RESULT_FILE) -> str:
    """Return the kind of run (``closed_loop``, ``solve``) whose ``run.json`` has this text.

    Raises:
        RunFolderError: if it is not JSON, or of a newer schema.
    """
    return str(_content(text, source).get("kind", RunResult.kind))  # version 0.1 had one kind only


def _content(text: str, source: str) -> dict[str, Any]:
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


def _metrics(content: Mapping[str, Any] | None) -> Metrics | None:
    if content is None:
        return None
    optional = {f.name for f in fields(Metrics) if f.default is not MISSING}  # not in the files of version 0.1
    values = {f.name: content[f.name] for f in fields(Metrics) if f.name in content or f.name not in optional}
    for name, kind in (
        ("mpc_ms", Timing),
        ("wbc_ms", Timing),
        ("estimator_ms", Timing),
        ("forecast_ms", Timing),
        ("estimator", EstimatorErrors),
        ("sensor_faults", SensorFaults),
        ("walking", WalkingMetrics),
        ("modes", ModeMetrics),
    ):
        if values.get(name) is not None:
            values[name] = kind(**{key: _number(value) for key, value in values[name].items()})
    return Metrics(**{name: _number(value) for name, value in values.items()})


def _number(value: Any) -> Any:
    """Return a metric unchanged if its type is valid.

    Raises:
        TypeError: not a number, a boolean, a group of metrics, or None.
        OverflowError: an integer beyond the range of floating-point numbers.
    """
    if isinstance(value, (int, float)):
        float(value)
    elif not (value is None or isinstance(value, (Timing, EstimatorErrors, SensorFaults, WalkingMetrics, ModeMetrics))):
        raise TypeError(f"a metric is {type(value).__name__}")
    return value
