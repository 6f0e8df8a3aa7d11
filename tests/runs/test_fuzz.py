"""Any damage to a run folder ends in a run, or in a RunFolderError: never in a crash."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.errors import RunFolderError
from lgmpc.runs import (
    Gate,
    HostInfo,
    Outcome,
    Run,
    RunFolder,
    RunLog,
    RunResult,
    SolveResult,
    Verdict,
    compute_metrics,
    flat_metrics,
    judge,
    load_run,
)

from .test_solved import trajectory

NOW = datetime(2026, 1, 1, tzinfo=timezone.utc)
MADE: dict[str, Any] = {"created": NOW.isoformat(), "versions": {"lgmpc": "0"}, "host": HostInfo("", "", "", 1, "")}
"""The same bytes in every run of the tests, so that a seed stands for a damage."""

JSON_VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    10**400,
    1e308,
    "",
    "abc",
    "pass",
    [],
    [[]],
    [None],
    {},
    {"a": {"b": []}},
)
ARRAYS: tuple[np.ndarray, ...] = (
    np.array(None, dtype=object),
    np.zeros(0),
    np.zeros((3, 0)),
    np.array(np.nan),
    np.array(True),
    np.array("text"),
    np.array([b"bytes"]),
    np.zeros(5, dtype=np.complex128),
    np.full((7, 3), np.inf),
    np.zeros((2, 2, 2, 2), dtype=np.int8),
)


@pytest.fixture
def closed_loop(standing: RunLog, tmp_path: Path) -> Path:
    metrics = compute_metrics(standing)
    folder = RunFolder.create(tmp_path, "closed_loop", NOW)
    folder.write_config("name: closed_loop\n")
    folder.write_arrays(standing.decimated(10))
    folder.write_result(RunResult("closed_loop", judge(metrics, Gate()), metrics, **MADE))
    return folder.path


@pytest.fixture
def solved(tmp_path: Path) -> Path:
    folder = RunFolder.create(tmp_path, "solved", NOW)
    folder.write_config("name: solved\n")
    folder.write_arrays(trajectory())
    folder.write_result(SolveResult("solved", Verdict(Outcome.PASS), "sqp", "converged", "", {"cost": 1.0}, **MADE))
    return folder.path


def damage(file: Path, rng: random.Random) -> None:
    """Damage a file: cut it, overwrite bytes, remove it, or change an entry of it."""
    change = rng.randrange(6)
    content = bytearray(file.read_bytes())
    if change == 0:
        file.write_bytes(content[: rng.randrange(len(content))])
    elif change == 1:
        for _ in range(rng.randint(1, 20)):
            content[rng.randrange(len(content))] = rng.randrange(256)
        file.write_bytes(content)
    elif change == 2:
        file.unlink()
    elif file.suffix == ".json":
        data = json.loads(content)
        around = data
        while True:
            key = rng.choice(sorted(around))
            if not isinstance(around[key], dict) or not around[key] or rng.random() < 0.3:
                break
            around = around[key]
        if rng.random() < 0.2:
            del around[key]
        else:
            around[key] = rng.choice(JSON_VALUES)
        file.write_text(json.dumps(data), encoding="utf-8")
    elif file.suffix == ".npz":
        with np.load(file) as archive:
            arrays = {name: archive[name] for name in archive.files}
        name = rng.choice(sorted(arrays))
        if rng.random() < 0.2:
            del arrays[name]
        else:
            arrays[name] = rng.choice([*ARRAYS, arrays[rng.choice(sorted(arrays))], -arrays["com"], arrays["com"][:1]])
        np.savez(file, **arrays)


def fuzz(path: Path, read: Callable[[Path], object], count: int) -> None:
    for seed in range(count):
        damaged = path.with_name("damaged")
        shutil.copytree(path, damaged)
        rng = random.Random(f"{path.name} {seed}")
        for file in rng.sample(sorted(damaged.iterdir()), rng.randint(1, 2)):
            damage(file, rng)
        try:
            read(damaged)
        except RunFolderError as error:
            assert str(error)
        except Exception as error:
            raise AssertionError(f"seed {seed}") from error
        shutil.rmtree(damaged)


def use(path: Path) -> None:
    """Read a folder, and rewrite what is in it."""
    run = load_run(path)
    run.result.to_json()
    if isinstance(run, Run) and run.result.metrics is not None:
        flat_metrics(run.result.metrics)


@pytest.mark.parametrize("count", [150, pytest.param(800, marks=pytest.mark.slow)])
def test_a_damaged_closed_loop_is_read_or_refused(closed_loop: Path, count: int) -> None:
    fuzz(closed_loop, use, count)


@pytest.mark.parametrize("count", [150, pytest.param(800, marks=pytest.mark.slow)])
def test_a_damaged_solve_is_read_or_refused(solved: Path, count: int) -> None:
    fuzz(solved, use, count)
