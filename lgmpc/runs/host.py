"""Versions and machine of a run, for ``run.json``."""

from __future__ import annotations

import functools
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

__all__ = ["HostInfo", "host_info", "versions"]

_PACKAGES = ("lgmpc", "pin", "casadi", "mujoco", "proxsuite", "osqp", "piqp", "numpy", "example-robot-data")


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


def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages on which results depend ("absent" if not installed)."""
    return {"python": platform.python_version(), **{package: _version_of(package) for package in _PACKAGES}}


@functools.cache  # reading a package's metadata takes milliseconds, and every point of a sweep has the versions
def _version_of(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "absent"


def host_info() -> HostInfo:
    """Return the properties of this machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return HostInfo(
        system=f"{platform.system()} {platform.release()}",
        machine=platform.machine(),
        cpu=_cpu_name(),
        cores=cores,
        threads=os.environ.get("OMP_NUM_THREADS", ""),
    )


def _cpu_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor()
