"""The run folder: ``config.yaml``, ``log.npz`` and ``run.json``, each complete or absent."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.errors import RunFolderError
from lgmpc.runs.atomic import atomic_write, reason_of
from lgmpc.runs.host import HostInfo, host_info, versions
from lgmpc.runs.log import RunLog
from lgmpc.runs.metrics import Metrics, Timing
from lgmpc.runs.verdict import Outcome, Verdict

__all__ = ["CONFIG_FILE", "LOG_FILE", "RESULT_FILE", "SCHEMA", "Run", "RunFolder", "RunResult"]

SCHEMA = 1
"""Version of the folder's format; a reader refuses a newer one."""

CONFIG_FILE, LOG_FILE, RESULT_FILE = "config.yaml", "log.npz", "run.json"


@dataclass(frozen=True)
class RunResult:
    """What ``run.json`` holds.

    Attributes:
        name: the run's name.
        verdict: pass, fail or interrupted, with reasons.
        metrics: what was measured; ``None`` if the run stopped before its first tick.
        seed: seed of the run's random numbers.
        created: when it was made, UTC, ISO 8601.
        versions: versions of Python and packages.
        host: the machine.
    """

    name: str
    verdict: Verdict
    metrics: Metrics | None
    seed: int = 0
    created: str = field(default_factory=lambda: datetime.now(timezone.utc).isoformat(timespec="seconds"))
    versions: Mapping[str, str] = field(default_factory=versions)
    host: HostInfo = field(default_factory=host_info)

    def to_json(self) -> str:
        """Return the text of ``run.json``."""
        content = {
            "schema": SCHEMA,
            "name": self.name,
            "created": self.created,
            "verdict": self.verdict.outcome.value,
            "reasons": list(self.verdict.reasons),
            "seed": self.seed,
            "metrics": None if self.metrics is None else _without_nan(asdict(self.metrics)),
            "versions": dict(self.versions),
            "host": asdict(self.host),
        }
        return json.dumps(content, indent=2, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str, source: str = RESULT_FILE) -> RunResult:
        """Read the text of a ``run.json``; ``source`` names it in errors.

        Raises:
            RunFolderError: if it is not JSON, of a newer schema, or lacks an entry.
        """
        try:
            content = json.loads(text)
        except json.JSONDecodeError as error:
            raise RunFolderError(f"{source} is not JSON: {error}") from error
        if not isinstance(content, dict) or not isinstance(content.get("schema"), int):
            raise RunFolderError(f"{source} has no schema number: not a run of lgmpc")
        if content["schema"] > SCHEMA:
            raise RunFolderError(
                f"{source} has schema {content['schema']}, this lgmpc reads up to {SCHEMA}: update lgmpc"
            )
        try:
            return cls(
                name=content["name"],
                verdict=Verdict(Outcome(content["verdict"]), tuple(content["reasons"])),
                metrics=_metrics(content["metrics"]),
                seed=content["seed"],
                created=content["created"],
                versions=content["versions"],
                host=HostInfo(**content["host"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise RunFolderError(f"{source} is damaged: {type(error).__name__} {error}") from error


def _without_nan(values: dict[str, Any]) -> dict[str, Any]:
    """JSON has no NaN and no infinity: what could not be measured is null."""
    return {
        name: _without_nan(value)
        if isinstance(value, dict)
        else None
        if isinstance(value, float) and not math.isfinite(value)
        else value
        for name, value in values.items()
    }


def _metrics(content: Mapping[str, Any] | None) -> Metrics | None:
    if content is None:
        return None
    values = {f.name: content[f.name] for f in fields(Metrics)}
    for name in ("mpc_ms", "wbc_ms"):
        values[name] = None if values[name] is None else Timing(**values[name])
    return Metrics(**values)


@dataclass(frozen=True)
class Run:
    """A run folder, read.

    Attributes:
        path: the folder.
        config: text of its ``config.yaml``.
        log: its arrays.
        result: its ``run.json``.
    """

    path: Path
    config: str
    log: RunLog
    result: RunResult


@dataclass(frozen=True)
class RunFolder:
    """A folder that a run writes its results into."""

    path: Path

    @classmethod
    def create(cls, out: Path | str, name: str, now: datetime | None = None) -> RunFolder:
        """Make ``out/<UTC time>-<name>/`` and prove that it can be written.

        Called before a run starts, so that nobody waits for a result that has nowhere to go. Two runs that start in
        the same second get two folders.

        Args:
            out: parent folder, made if it does not exist.
            name: the run's name; characters that do not belong into a file name become "-".
            now: the time to put into the name; the current time if not given.

        Raises:
            RunFolderError: if it cannot be made or written, with the reason.
        """
        out = Path(out)
        stamp = (now or datetime.now(timezone.utc)).astimezone(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        slug = re.sub(r"[^A-Za-z0-9_.]+", "-", name).strip("-.") or "run"
        try:
            out.mkdir(parents=True, exist_ok=True)
            count = 1
            while True:
                path = out / (f"{stamp}-{slug}" if count == 1 else f"{stamp}-{slug}-{count}")
                try:
                    path.mkdir()
                    break
                except FileExistsError:
                    count += 1
        except OSError as error:
            raise RunFolderError(
                f"cannot make a run folder in {out}: {reason_of(error)}. Choose another one with --out"
            ) from error
        return cls(path)

    def write_config(self, text: str) -> None:
        """Write the resolved configuration, YAML."""
        self._write(CONFIG_FILE, text)

    def write_log(self, log: RunLog) -> None:
        """Write the arrays. :class:`RunLog` holds plain numbers and strings only, so nothing in the file is pickled."""
        with atomic_write(self.path / LOG_FILE) as file:
            arrays: dict[str, Any] = dict(log.arrays())
            np.savez(file, **arrays)

    def write_result(self, result: RunResult) -> None:
        """Write ``run.json``: last, because a folder that has it is complete."""
        self._write(RESULT_FILE, result.to_json())

    def _write(self, name: str, text: str) -> None:
        with atomic_write(self.path / name) as file:
            file.write(text.encode("utf-8"))

    @staticmethod
    def load(path: Path | str) -> Run:
        """Read a run folder and check it.

        Raises:
            RunFolderError: if it is not one, or a file is missing, damaged, or of a newer schema.
        """
        path = Path(path)
        if not path.is_dir():
            raise RunFolderError(f"{path} is not a folder" if path.exists() else f"{path} does not exist")
        missing = [name for name in (CONFIG_FILE, LOG_FILE, RESULT_FILE) if not (path / name).is_file()]
        if missing:
            raise RunFolderError(f"{path} is not a complete run folder: no {', no '.join(missing)}{_hint(path)}")
        try:
            config = (path / CONFIG_FILE).read_text(encoding="utf-8")
            text = (path / RESULT_FILE).read_text(encoding="utf-8")
            result = RunResult.from_json(text, str(path / RESULT_FILE))
            return Run(path, config, _read_log(path / LOG_FILE), result)
        except OSError as error:
            raise RunFolderError(f"cannot read {path}: {reason_of(error)}") from error
        except UnicodeDecodeError as error:
            raise RunFolderError(f"cannot read {path}: not UTF-8 text ({error.reason})") from error


def _read_log(path: Path) -> RunLog:
    try:
        # Opened here, because np.load leaves a damaged file open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise RunFolderError(f"{path} is damaged: {error}") from error
    try:
        return RunLog.from_arrays(arrays)
    except RunFolderError as error:
        raise RunFolderError(f"{path}: {error}") from error


def _hint(path: Path) -> str:
    """If ``path`` holds run folders instead of being one, name the newest."""
    runs = sorted(child.name for child in path.iterdir() if (child / RESULT_FILE).is_file())
    return f". It holds {len(runs)} run folders; the newest is {path / runs[-1]}" if runs else ""
