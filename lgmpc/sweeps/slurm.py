"""Workers in jobs of SLURM."""

from __future__ import annotations

import logging
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from lgmpc.config.loading import validated
from lgmpc.config.schema import ConfigSource
from lgmpc.config.yaml_text import parse_yaml, read_text
from lgmpc.errors import ClusterError, ConfigError, InputError, MissingDependencyError
from lgmpc.settings import Count, Positive, Settings
from lgmpc.settings.messages import show_value

if TYPE_CHECKING:
    import distributed

__all__ = ["SlurmSettings", "load_slurm", "slurm_client"]


class SlurmSettings(Settings):
    """The jobs that compute a sweep: identical, and submitted again when they reach their wall time."""

    jobs: Count = Field(default=1, description="Number of jobs at a time.")
    cores: Count = Field(description="Processors of a job; each computes one point at a time.")
    memory_gb: Positive = Field(description="Memory of a job, GB: at least that of a point times `cores`.")
    walltime: str = Field(
        pattern=r"^(\d+-)?\d{1,2}:\d{2}:\d{2}$",
        description="Longest time of a job, [days-]hours:minutes:seconds; points unfinished at its end are repeated.",
    )
    queue: str | None = Field(default=None, min_length=1, description="Partition; SLURM's default unless given.")
    account: str | None = Field(default=None, min_length=1, description="Account that is charged.")
    directives: tuple[Annotated[str, Field(pattern=r"^-")], ...] = Field(
        default=(), description="Further options of sbatch, such as '--constraint=avx2': one #SBATCH line each."
    )
    setup: tuple[str, ...] = Field(
        default=(), description="Lines of shell that a job executes first, such as 'module load gcc'."
    )
    interface: str | None = Field(
        default=None, min_length=1, description="Network interface of the scheduler and the workers, such as ib0."
    )
    start_s: Positive = Field(default=60.0, description="Longest time that a job waits for the sweep's scheduler, s.")


def load_slurm(file: Path) -> SlurmSettings:
    """Read and check a YAML file of :class:`SlurmSettings`.

    Raises:
        ConfigError: if it cannot be read, is not YAML, or has keys or values that cannot be used.
    """
    data, places = parse_yaml(read_text(file, "a YAML file of cores, memory_gb, walltime, ..."), str(file))
    if not isinstance(data, dict):
        raise ConfigError(
            str(file), "", show_value(data), "a table of keys (cores: ..., memory_gb: ..., walltime: ...)"
        )
    return validated(SlurmSettings, data, ConfigSource(str(file), places))


@contextmanager
def slurm_client(settings: SlurmSettings, folder: Path) -> Iterator[distributed.Client]:
    """Submit jobs for the duration of a block, and connect to the Dask workers in them.

    The scheduler runs in this process, so this process must be reachable from the jobs' machines: on a login node, or
    in a job of its own. Jobs left at the end of the block are cancelled.

    Args:
        settings: settings of the jobs.
        folder: folder for the output of the jobs, ``lgmpc-<number>.out`` and ``.err``.

    Raises:
        InputError: this machine has no ``sbatch``.
        ClusterError: SLURM rejects the job.
        MissingDependencyError: dask-jobqueue is not installed.
    """
    try:
        import distributed

        dask_jobqueue = _import_jobqueue()
    except ImportError as error:
        raise MissingDependencyError("dask-jobqueue", "a sweep on SLURM", 'pip install "lgmpc[dask]"') from error
    if shutil.which("sbatch") is None:
        raise InputError("slurm", "no program sbatch on this machine", "a machine that submits jobs to SLURM")
    options: dict[str, Any] = {} if settings.interface is None else {"interface": settings.interface}
    cluster = dask_jobqueue.SLURMCluster(
        job_name="lgmpc",
        cores=settings.cores,
        processes=settings.cores,
        memory=f"{settings.memory_gb:g}GB",
        walltime=settings.walltime,
        queue=settings.queue,
        account=settings.account,
        job_extra_directives=list(settings.directives),
        job_script_prologue=list(settings.setup),
        log_directory=str(folder.resolve()),
        python=sys.executable,
        death_timeout=settings.start_s,
        scheduler_options={"dashboard_address": "127.0.0.1:0"},  # any free port
        silence_logs=logging.CRITICAL,
        **options,
    )
    with cluster, distributed.Client(cluster) as client:
        _check_accepted(cluster.job_script())
        cluster.adapt(minimum_jobs=settings.jobs, maximum_jobs=settings.jobs)
        yield client


def _import_jobqueue() -> ModuleType:
    """Import dask-jobqueue, and restore this program's handler of Ctrl-C, which the import replaces."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        import dask_jobqueue
    finally:
        signal.signal(signal.SIGINT, handler)
    module: ModuleType = dask_jobqueue
    return module


def _check_accepted(script: str) -> None:
    """Check that SLURM accepts a job: dask-jobqueue only logs a rejection, and waits."""
    with NamedTemporaryFile("w", suffix=".sh", encoding="utf-8") as file:
        file.write(script)
        file.flush()
        done = subprocess.run(["sbatch", "--test-only", file.name], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        reason = (done.stderr or done.stdout).strip() or f"exit code {done.returncode}"
        raise ClusterError(f"SLURM rejects the job: {reason}. Change the file given to --slurm")
