"""Checks of the installation: each executes a small example of one feature and reports the result.

Nothing is printed and nothing raises: a check that fails for any reason reports it with a remedy. All dependencies but
numpy are imported inside the check that requires them, so that a broken package fails its own check only.
"""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lgmpc.chromium import find_chromium
from lgmpc.errors import CompileError, InputError

if TYPE_CHECKING:
    from lgmpc.compile import Compiler
    from lgmpc.robot import Robot
    from lgmpc.typing import Array

__all__ = ["Check", "iterate_checks"]

_OLDEST_PYTHON = (3, 10)
_REINSTALL = "pip install --force-reinstall lgmpc"


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
    yield _guarded("python", _check_python, "")
    yield from _check_dependencies()
    yield _guarded("compiler", _check_compiler, "apt install gcc")
    yield _guarded("compiled code", _check_compiled_code, "apt install gcc libc6-dev, or LGMPC_JIT=0 to interpret")
    yield _guarded("cache", _check_cache, "choose a folder of your own with LGMPC_CACHE_DIR")
    yield _guarded("robot", _check_robot, 'pip install "pin>=4,<5" "example-robot-data-loaders>=4.4,<6"')
    for name, solve in _QP_SOLVERS.items():
        yield _guarded(f"QP by {name}", functools.partial(_check_qp, name, solve), f"pip install {name}")
    for name in _QUIET:
        yield _guarded(f"NLP by {name}", functools.partial(_check_nlp, name), "pip install --force-reinstall casadi")
    yield _guarded("mujoco plant", _check_mujoco, "pip install mujoco")
    yield _guarded("chromium", _check_chromium, "")
    yield _guarded("threads", _check_threads, "")


def _guarded(name: str, check: Callable[[], Check], remedy: str) -> Check:
    """Return the result of a check; an exception is a failure."""
    try:
        return check()
    except InputError as error:
        return Check(name, False, f"{error.argument}: got {error.got}", f"expected {error.expected}")
    except Exception as error:  # noqa: BLE001 (any exception of a broken installation is a finding)
        detail = str(error) if isinstance(error, CompileError) else f"{type(error).__name__}: {error}"
        return Check(name, False, detail, remedy or _REINSTALL)


def _check_python() -> Check:
    detail = f"{platform.python_implementation()} {platform.python_version()} on {platform.platform()}, {sys.prefix}"
    wanted = ".".join(map(str, _OLDEST_PYTHON))
    ok = sys.version_info >= _OLDEST_PYTHON
    return Check("python", ok, detail, "" if ok else f"install Python {wanted} or newer")


def _check_dependencies() -> Iterator[Check]:
    """Yield a check for every package that lgmpc's metadata requires, against the range of tested versions."""
    try:
        from packaging.requirements import Requirement

        declared = [Requirement(line) for line in metadata.requires("lgmpc") or ()]
    except (ImportError, metadata.PackageNotFoundError) as error:
        yield Check(
            "dependencies", False, f"{type(error).__name__}: {error}", "pip install lgmpc (or pip install -e .)"
        )
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


def _check_compiler() -> Check:
    from lgmpc.compile import find_compiler, jit_enabled

    if not jit_enabled():
        return Check(
            "compiler", True, "not used: LGMPC_JIT=0", "unset LGMPC_JIT: compiled functions are about 20 times faster"
        )
    compiler = find_compiler()
    if compiler is None:
        slow = "none found: every function is interpreted, about 20 times slower, too slow for real time"
        return Check("compiler", False, slow, "apt install gcc, or without root: pip install ziglang")
    return Check("compiler", True, f"{compiler.name}: {' '.join((*compiler.command, *compiler.flags))}")


def _check_compiled_code() -> Check:
    """Compile a function anew, on the cache's volume (which may forbid execution), and compare with the interpreter."""
    from lgmpc.compile import cache_folder, find_compiler, jit_enabled

    compiler = find_compiler() if jit_enabled() else None
    if compiler is None:
        return Check("compiled code", True, "not tried: no compiler is used")
    with tempfile.TemporaryDirectory(prefix=".build-", dir=cache_folder()) as folder:
        seconds, per_call, difference = _compile_and_compare(compiler, Path(folder))
    ok = difference < 1e-12
    detail = f"built in {seconds:.2f} s, {per_call * 1e6:.2f} us a call, {difference:.0e} from the interpreter's values"
    return Check("compiled code", ok, detail, "" if ok else "unset LGMPC_CFLAGS, or choose another compiler with CC")


def _compile_and_compare(compiler: Compiler, folder: Path) -> tuple[float, float, float]:
    import casadi

    from lgmpc.compile.native import bind_library, generate_source

    x = casadi.SX.sym("x", 3)
    function = casadi.Function(
        "self_test", [x], [casadi.sin(x) * casadi.sqrt(casadi.sumsqr(x)), casadi.cross(x, x + 1)]
    )
    source, library = folder / "self_test.c", folder / "self_test.so"
    source.write_text(generate_source(function))
    start = time.perf_counter()
    compiler.build([source], library, function.name())
    seconds = time.perf_counter() - start
    loaded = ctypes.CDLL(str(library))
    point, *results = np.array([0.3, -1.2, 2.1]), np.zeros(3), np.zeros(3)
    run = bind_library(loaded, function.name(), (point, *results), stages=1, steps=(0, 0, 0))
    run()
    pairs = zip(results, function(point), strict=True)
    difference = max(float(np.max(np.abs(got - np.asarray(expected).ravel()))) for got, expected in pairs)
    calls = 1000
    start = time.perf_counter()
    for _ in range(calls):
        run()
    return seconds, (time.perf_counter() - start) / calls, difference


def _check_cache() -> Check:
    from lgmpc.compile import cache_folder, inspect_cache

    report = inspect_cache(cache_folder())
    count = f"{report.entries} librar{'y' if report.entries == 1 else 'ies'}"
    detail = f"{report.folder}: {count}, {report.size_bytes / 1e6:.1f} MB"
    if report.damaged:
        return Check("cache", True, f"{detail}, {len(report.damaged)} damaged", "none needed: they are built again")
    return Check("cache", True, detail)


def _load_solo12() -> Robot:
    from lgmpc.robot import RobotSpec, load_robot

    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
            contact_radius_m=0.016,
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad=(-3.0, 3.0),
            armature_kg_m2=3.6e-4,
        )
    )


def _check_robot() -> Check:
    robot = _load_solo12()
    return Check("robot", True, f"{robot.name}: {robot.nu} actuated joints, {robot.mass:.2f} kg")


# minimise |x|^2 / 2 - 2 x_0 subject to x_0 + x_1 = 1 and 0 <= x: at (1, 0), held there by the bound on x_1.
_QP_SOLUTION = (1.0, 0.0)


def _solve_by_osqp() -> Array:
    import osqp
    from scipy import sparse

    solver = osqp.OSQP()
    rows = sparse.csc_matrix(np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
    upper = np.array([1.0, np.inf, np.inf])
    tolerances = {"eps_abs": 1e-9, "eps_rel": 1e-9}
    lower = np.array([1.0, 0.0, 0.0])
    solver.setup(sparse.eye(2, format="csc"), np.array([-2.0, 0.0]), rows, lower, upper, verbose=False, **tolerances)
    return np.asarray(solver.solve(raise_error=True).x)


def _solve_by_piqp() -> Array:
    import piqp

    solver = piqp.DenseSolver()
    equality, right = np.ones((1, 2)), np.ones(1)
    solver.setup(np.eye(2), np.array([-2.0, 0.0]), equality, right, x_l=np.zeros(2))
    solver.solve()
    return np.asarray(solver.result.x)


def _solve_by_proxsuite() -> Array:
    from lgmpc.proxqp import proxqp

    solver = proxqp.dense.QP(2, 1, 2)
    solver.settings.eps_abs = 1e-9
    equality, right = np.ones((1, 2)), np.ones(1)
    solver.init(np.eye(2), np.array([-2.0, 0.0]), equality, right, np.eye(2), np.zeros(2), np.full(2, 1e20))
    solver.solve()
    return np.asarray(solver.results.x)


_QP_SOLVERS: dict[str, Callable[[], Array]] = {
    "osqp": _solve_by_osqp,
    "piqp": _solve_by_piqp,
    "proxsuite": _solve_by_proxsuite,
}


def _check_qp(name: str, solve: Callable[[], Array]) -> Check:
    error = float(np.max(np.abs(solve() - _QP_SOLUTION)))
    ok = error < 1e-6
    return Check(f"QP by {name}", ok, f"{error:.0e} from the known solution", "" if ok else f"pip install -U {name}")


_QUIET: dict[str, dict[str, Any]] = {"ipopt": {"print_level": 0, "sb": "yes"}, "fatrop": {"print_level": 0}}
"""Options by which CasADi's plugins print nothing."""


def _check_nlp(name: str) -> Check:
    """Minimise by CasADi's plugin (x - 2)^2 subject to x <= 1."""
    import casadi

    x = casadi.MX.sym("x")
    problem: dict[str, Any] = {"x": x, "f": (x - 2.0) ** 2, "g": x}
    options: dict[str, Any] = {"print_time": False, name: _QUIET[name]}
    found = casadi.nlpsol("self_test", name, problem, options)(x0=0.0, lbg=-casadi.inf, ubg=1.0)["x"]
    error = abs(float(found) - 1.0)
    ok = error < 1e-6
    return Check(f"NLP by {name}", ok, f"{error:.0e} from the known solution", "" if ok else _REINSTALL)


def _check_mujoco() -> Check:
    from lgmpc.simulation.mujoco import MujocoPlant

    robot = _load_solo12()
    plant = MujocoPlant(robot)
    plant.reset(robot.x_reference)
    steps = 100
    start = time.perf_counter()
    for _ in range(steps):
        plant.step(np.zeros(robot.nu))
    each = (time.perf_counter() - start) / steps
    finite = bool(np.all(np.isfinite(plant.sense().q)))
    detail = f"{steps} steps of {robot.name}, {each * 1e6:.0f} us each" if finite else "the robot's state is not finite"
    return Check("mujoco plant", finite, detail, "" if finite else "pip install -U mujoco")


def _check_chromium() -> Check:
    found = find_chromium()
    if found is None:
        return Check("chromium", True, "none found", "only pictures of replays need one: apt install chromium")
    return Check("chromium", True, str(found))


def _check_threads() -> Check:
    setting = os.environ.get("OMP_NUM_THREADS")
    cores = os.cpu_count() or 1
    if setting == "1":
        return Check("threads", True, f"OMP_NUM_THREADS=1, {cores} cores")
    found = "OMP_NUM_THREADS is not set" if setting is None else f"OMP_NUM_THREADS={setting}"
    return Check(
        "threads", True, f"{found}, {cores} cores", "export OMP_NUM_THREADS=1: small matrices are slower otherwise"
    )
