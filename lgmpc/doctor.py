"""Checks of the installation: each tries one feature, by a small example or an import, and reports the result.

Nothing is printed and nothing raises: a check that fails for any reason reports it with a remedy. All dependencies but
numpy are imported inside the check that requires them, so that a broken package fails its own check only.
"""

import ctypes
import importlib
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lgmpc.chromium import find_chromium
from lgmpc.errors import CompileError, InputError

if TYPE_CHECKING:
    from lgmpc.robot import Robot


@dataclass(frozen=True)
class Check:
    """The result of one check.

    Attributes:
        name: short name of the checked feature.
        ok: whether it works.
        detail: the findings.
        remedy: recommended action; empty if there is none. A check that is ok may have one too.
    """

    name: str
    ok: bool
    detail: str
    remedy: str = ""


def iterate_checks() -> Iterator[Check]:
    """Yield the results one by one, each check executed when the iterator reaches it; a few seconds in all."""
    yield Check("python", True, f"{platform.python_implementation()} {platform.python_version()}, {sys.prefix}")
    yield from _check_dependencies()
    yield _guarded("compiler", _check_compiler, "apt install gcc, or without root: pip install ziglang")
    yield _guarded("compiled code", _check_compiled_code, "apt install gcc libc6-dev, or LGMPC_JIT=0 to interpret")
    yield _guarded("cache", _check_cache, "choose a folder of your own with LGMPC_CACHE_DIR")
    yield _guarded("robot", _check_robot, 'pip install "pin>=4,<5" "example-robot-data-loaders>=4.4,<6"')
    for name, module in (("osqp", "osqp"), ("piqp", "piqp"), ("proxsuite", "lgmpc.proxqp")):
        yield _guarded(f"QP by {name}", partial(_check_import, module), f"pip install -U {name}")
    for name in ("ipopt", "fatrop"):
        yield _guarded(f"NLP by {name}", partial(_check_plugin, name), "pip install --force-reinstall casadi")
    yield _guarded("mujoco plant", _check_mujoco, "pip install -U mujoco")
    chromium, setting = find_chromium(), os.environ.get("OMP_NUM_THREADS", "not set")
    advice = "" if chromium else "only pictures of replays need one: apt install chromium"
    yield Check("chromium", True, str(chromium or "none found"), advice)
    advice = "" if setting == "1" else "export OMP_NUM_THREADS=1: small matrices are slower otherwise"
    yield Check("threads", True, f"OMP_NUM_THREADS: {setting}, {os.cpu_count() or 1} cores", advice)


class _Broken(Exception):
    """The finding of a check that failed."""


def _guarded(name: str, check: Callable[[], str], remedy: str) -> Check:
    """Return the result of a check, which returns a finding; an exception is a failure."""
    try:
        return Check(name, True, check())
    except InputError as error:
        return Check(name, False, f"{error.argument}: got {error.got}", f"expected {error.expected}")
    except (CompileError, _Broken) as error:
        return Check(name, False, str(error), remedy)
    except Exception as error:  # noqa: BLE001 (any exception of a broken installation is a finding)
        return Check(name, False, f"{type(error).__name__}: {error}", remedy)


def _check_dependencies() -> Iterator[Check]:
    """Yield a check for every package that lgmpc's metadata requires, against the range of tested versions."""
    try:
        from packaging.requirements import Requirement

        declared = [Requirement(line) for line in metadata.requires("lgmpc") or ()]
    except (ImportError, metadata.PackageNotFoundError) as error:
        words = f"{type(error).__name__}: {error}"
        yield Check("dependencies", False, words, "pip install lgmpc (or pip install -e .)")
        return
    for requirement in declared:
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            yield _check_version(requirement.name, requirement.specifier, f'pip install "{requirement}"')


def _check_version(package: str, tested: Any, install: str) -> Check:
    ordered = ",".join(sorted(map(str, tested), reverse=True))
    try:
        version = metadata.version(package)
    except metadata.PackageNotFoundError:
        return Check(package, False, f"not installed (tested with {ordered})", install)
    ok = bool(tested.contains(version, prereleases=True))
    return Check(package, ok, f"{version} (tested with {ordered})", "" if ok else install)


def _check_compiler() -> str:
    from lgmpc.compile import find_compiler, jit_enabled

    if not jit_enabled():
        return "not used: LGMPC_JIT=0 (compiled functions are about 20 times faster)"
    compiler = find_compiler()
    if compiler is None:
        raise _Broken("none found: every function is interpreted, about 20 times slower, too slow for real time")
    return f"{compiler.name}: {' '.join((*compiler.command, *compiler.flags))}"


def _check_compiled_code() -> str:
    """Compile a function anew, on the cache's volume (which may forbid execution), and compare with the interpreter."""
    import casadi

    from lgmpc.compile import cache_folder, find_compiler, jit_enabled
    from lgmpc.compile.native import bind_library
    from lgmpc.compile.simd import generate_simd

    compiler = find_compiler() if jit_enabled() else None
    if compiler is None:
        return "not tried: no compiler is used"
    x = casadi.SX.sym("x", 3)
    function = casadi.Function("self_test", [x], [casadi.sin(x) * casadi.sqrt(casadi.sumsqr(x))])
    with tempfile.TemporaryDirectory(prefix=".build-", dir=cache_folder()) as folder:
        source, library = Path(folder) / "self_test.c", Path(folder) / "self_test.so"
        source.write_text(*generate_simd(function, lanes=False))
        compiler.build([source], library, function.name())
        point, result = np.array([0.3, -1.2, 2.1]), np.zeros(3)
        bind_library(ctypes.CDLL(str(library)), function.name(), (point, result), stages=1, steps=(0, 0))()
    difference = float(np.abs(result - function(point).full()[:, 0]).max())
    detail = f"{difference:.0e} from the interpreter's values"
    if not difference < 1e-12:
        raise _Broken(f"{detail}: LGMPC_CFLAGS is set, or the compiler is at fault")
    return detail


def _check_cache() -> str:
    from lgmpc.compile import cache_folder, inspect_cache

    report = inspect_cache(cache_folder())
    detail = f"{report.folder}: {report.entries} compiled, {report.size_bytes / 1e6:.1f} MB"
    return f"{detail}, {len(report.damaged)} damaged, which are built again" if report.damaged else detail


def _check_robot() -> str:
    robot = _load_solo12()
    return f"{robot.name}: {robot.nu} actuated joints, {robot.mass:.2f} kg"


def _load_solo12() -> "Robot":
    from lgmpc.robot import RobotSpec, load_robot

    limits: dict[str, Any] = {"effort_limit_nm": 1.8, "velocity_limit_rad_s": 30.0, "position_limit_rad": (-3.0, 3.0)}
    feet = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    return load_robot(RobotSpec(model="solo12", contact_frames=feet, contact_radius_m=0.016, **limits))


def _check_import(module: str) -> str:
    return f"{importlib.import_module(module).__name__} imports"


def _check_plugin(name: str) -> str:
    import casadi

    version = metadata.version("casadi")
    if not casadi.has_nlpsol(name):
        raise _Broken(f"casadi {version} cannot load its plugin {name}")
    return f"plugin of casadi {version}"


def _check_mujoco() -> str:
    from lgmpc.simulation.mujoco import MujocoPlant

    robot, steps = _load_solo12(), 100
    plant = MujocoPlant(robot)
    plant.reset(robot.x_reference)
    for _ in range(steps):
        plant.step(np.zeros(robot.nu))
    if not np.all(np.isfinite(plant.sense().q)):
        raise _Broken("the robot's state is not finite")
    return f"{steps} steps of {robot.name}"
