"""Settings of all tests: reproducible property tests, one thread a process, Ctrl-C that works."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from tests.support.displaced import DISPLACEMENTS, Displacement

if TYPE_CHECKING:
    from lgmpc.sweeps.pool import Pool

settings.register_profile("lgmpc", deadline=None, derandomize=True)
settings.load_profile("lgmpc")

# Six thousand collected tests are a million objects, which every search for garbage of the oldest generation visits.
gc.set_threshold(20_000, 20, 50)

# A shell script's `pytest &` ignores SIGINT, and so do the programs that it starts; some tests send it to them.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Interpret all functions: few calls take less than compiling. Machine code is compared in tests/test_compile.py,
    test_pipeline.py and test_stage_kernel.py.
    """
    monkeypatch.setenv("LGMPC_JIT", "0")


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of compiled functions for one test, and no settings of the compiler from the environment."""
    for name in ("CC", "LGMPC_CFLAGS", "LGMPC_JIT"):
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "cache"
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(folder))
    return folder


@pytest.fixture(scope="session")
def worker() -> Iterator[Pool]:
    """A worker process of sweeps, started for the first test that uses it."""
    from lgmpc.sweeps.pool import Pool
    from lgmpc.sweeps.trial import start_worker

    with Pool(1, start_worker, time_limit_s=300.0) as pool:
        yield pool


@pytest.fixture
def one_worker(worker: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sweeps of a test compute in a process that exists already, because a new one imports everything anew."""
    monkeypatch.setattr("lgmpc.sweeps.execution.Pool", lambda *_: nullcontext(worker))


@pytest.fixture(params=DISPLACEMENTS)
def displacement(request: pytest.FixtureRequest) -> Displacement:
    """A rigid displacement of world, robot and gravity: the same experiment, in another frame."""
    return DISPLACEMENTS[request.param]
