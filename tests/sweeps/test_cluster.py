"""Sweeps on Dask: two workers on this machine, one of which is killed; schedulers and workers that cannot be used."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from lgmpc.config.execution import run_config
from lgmpc.errors import ClusterError, InputError
from lgmpc.sweeps import Ending, SweepProgress, run_sweep
from lgmpc.sweeps.pool import DaskPool, Died

from .conftest import Parse

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.slow

FAILURES = {"distributed.scheduler.allowed-failures": 1}
"""One worker may end under a task, not two; three by default, which would only take longer."""


@pytest.fixture(scope="module")
def client() -> Iterator["distributed.Client"]:
    with (
        dask.config.set(FAILURES),
        distributed.LocalCluster(2, threads_per_worker=1, memory_limit=0, dashboard_address="127.0.0.1:0") as cluster,
        distributed.Client(cluster) as found,
    ):
        yield found


def act(task: str) -> str:
    if task == "hang":
        time.sleep(600.0)
    return f"{task} in {os.getpid()}"


def test_a_task_that_hangs_costs_its_workers_only(client: "distributed.Client", tmp_path: Path) -> None:
    with DaskPool(client.scheduler.address, 2.0, tmp_path) as pool:
        found = dict(pool.map(act, ["a", "hang", "b"]))
    assert isinstance(found["hang"], Died)
    assert [str(found[name]).split(" in ")[0] for name in "ab"] == ["a", "b"]


def test_a_sweep_continues_after_a_killed_worker_with_the_points_of_one_machine(
    client: "distributed.Client", tmp_path: Path, parse: Parse
) -> None:
    sweep = parse("factors: [{key: seed, kind: values, values: [1, 2, 3, 4]}]\nmetrics: [max_tilt_deg]")

    def kill_one(now: SweepProgress) -> None:
        if now.done == 1:
            os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

    there = run_sweep(sweep, tmp_path / "there", dask=client.scheduler.address, progress=kill_one)
    assert {row.ending for row in there.rows.values()} == {Ending.PASS}
    lines = (tmp_path / "there" / "results.jsonl").read_text().splitlines()
    assert len(lines) == len(there.rows) == 4  # the killed worker's point is computed again, and is one row
    for point in sweep.points:
        here = run_config(point.config, tmp_path / "here").session.metrics
        assert here is not None
        assert there.rows[point.key].metrics == {"max_tilt_deg": here.max_tilt_deg}
    assert len(list((tmp_path / "there" / "logs").iterdir())) == 4


def test_a_worker_that_sees_another_folder_or_has_other_versions_ends_the_sweep(
    client: "distributed.Client", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = client.scheduler.address
    words = "has no folder .*elsewhere: choose a shared folder"
    with (
        DaskPool(there, 4.0, tmp_path / "elsewhere") as pool,
        pytest.raises(ClusterError, match=words),
    ):
        list(pool.map(act, ["a"]))
    monkeypatch.setattr("lgmpc.sweeps.pool.versions", lambda: {"lgmpc": "0.0"})
    words = "has other versions: lgmpc .* instead of 0.0"
    with (
        DaskPool(there, 4.0, tmp_path) as pool,
        pytest.raises(ClusterError, match=words),
    ):
        list(pool.map(act, ["a"]))


def test_a_lost_scheduler_ends_the_sweep(tmp_path: Path) -> None:
    with distributed.LocalCluster(n_workers=1, dashboard_address="127.0.0.1:0") as cluster:
        with DaskPool(cluster.scheduler_address, 60.0, tmp_path) as pool:
            results = pool.map(act, ["a", "hang", "b"])
            next(results)
            cluster.close()
            with pytest.raises(ClusterError, match="connection to the Dask scheduler is lost.*--resume"):
                list(results)


def test_no_scheduler_and_workers_of_a_scheduler_are_one_error(tmp_path: Path, parse: Parse) -> None:
    sweep = parse("variants: {a: {}}")
    with pytest.raises(InputError, match="dask: got tcp://127.0.0.1:9; expected the address of a running scheduler"):
        run_sweep(sweep, tmp_path / "out", dask="tcp://127.0.0.1:9")
    with pytest.raises(InputError, match="workers: got 2; expected none: the cluster has its own"):
        run_sweep(sweep, tmp_path / "out", dask="tcp://127.0.0.1:9", workers=2)
