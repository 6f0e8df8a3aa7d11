"""The subpackages of lgmpc and their allowed imports, checked in the source of every module.

The arrows:

    lie -> state -> robot -> costs -> actions -> ocp -> solvers -> mpc
    robot -> wbc, locomotion      world -> locomotion, estimation, simulation, runs, viz
    lie, robot -> estimation      lie -> mechanics      parts -> control
    control.interface -> estimation, simulation, hardware      simulation -> hardware
    everything -> config -> sweeps, live -> cli
"""

from __future__ import annotations

import ast
import functools
import graphlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "lgmpc"
LONGEST_MODULE = 450
MOST_LINES, MOST_FILES = 62_000, 343
"""Of the package (scripts/size.py prints them by room). Something goes before something is added."""

# Every subpackage may import these.
FOUNDATION = "errors status typing timegrid support settings shipped compile proxqp chromium"

_PROBLEMS = "lie state robot costs actions ocp"
_PARTS = f"{_PROBLEMS} solvers mpc wbc estimation locomotion"

# Subpackage (or one module of it, which then has its own row) -> those that it may import, besides the foundation.
ARROWS: dict[str, str] = {
    "lie": "",
    "state": "lie",
    "world": "",
    "robot": "lie state",
    "costs": "lie state robot",
    "actions": "lie state robot costs",
    "ocp": "lie state robot costs actions",
    "problems": f"{_PROBLEMS} locomotion world",
    "solvers": _PROBLEMS,
    "mpc": f"{_PROBLEMS} solvers locomotion",
    "wbc": "lie state robot costs",
    "locomotion": "lie state robot world",
    "simulation": "lie state robot world control.interface",
    "estimation": "lie state robot world control.interface",
    "mechanics": "lie",
    "control": f"{_PARTS} world",
    "control.interface": "",
    "hardware": "control.interface",
    "hardware.simulated": "control.interface simulation world",
    "demos": f"{_PARTS} mechanics control simulation",
    "runs": "lie world",
    "viz": "lie state robot world runs demos",
    "config": "",
    # A document composes the settings of the subpackages.
    "config.schema": f"{_PARTS} world simulation control hardware runs problems",
    "config.robots": "robot world locomotion control simulation runs",
    "config.build": f"{_PARTS} world simulation control runs",
    "config.maneuvers": "robot control problems runs",
    "config.solving": "actions ocp problems robot runs solvers",
    "config.closed_loop": f"{_PARTS} world simulation control runs",
    "config.deploying": f"{_PARTS} world simulation control hardware runs",
    "config.exporting": "mpc runs wbc",
    "config.extensions": "costs mpc robot wbc",
    "config.execution": "ocp problems robot world runs solvers viz",
    "config.showing": "robot world problems solvers runs viz",
    "config.session": "runs solvers",
    "sweeps": "config runs viz",
    "live": "lie robot world locomotion mpc control hardware simulation config runs viz",
    "gym": "config control lie locomotion runs simulation",
    "doctor": f"{_PARTS} simulation",
    "cli": "config problems robot runs viz doctor demos sweeps hardware live",
    "__main__": "cli",
    # The foundation itself, and the package's own module.
    "errors": "",
    "status": "",
    "typing": "errors",
    "timegrid": "errors typing",
    "support": "typing",
    "settings": "errors typing",
    "compile": "errors typing",
    "proxqp": "",
    "chromium": "",
    "shipped": "errors",
    "": "",
}

# Outside package -> the only modules (or subpackages) that may import it.
OWNERS: dict[str, str] = {
    "mujoco": "simulation.mujoco doctor",
    "crocoddyl": "",
    "meshcat": "viz",
    "matplotlib": "viz",
    "playwright": "viz",
    "pandas": "runs",
    "pyarrow": "runs",
    "foxglove": "viz",
    "rerun": "viz",
    "gymnasium": "gym",
    "proxsuite": "proxqp",
    "osqp": "solvers",
    "piqp": "solvers",
    "yaml": "config",
    "typer": "cli",
    "IPython": "viz",
    "rich": "cli",
    "viser": "live",
}

# Packages that must not be loaded by importing the package or a subpackage that computes: slow, or with a display.
HEAVY = ("mujoco", "crocoddyl", "meshcat", "matplotlib", "playwright", "rich", "typer", "viser")
COMPUTING = (
    "compile lie state robot costs actions ocp problems solvers mpc wbc estimation simulation mechanics demos control"
    " runs doctor"
)


def modules(package: Path) -> Iterator[tuple[str, Path]]:
    """Dotted name within the package, and file, of every module."""
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


@functools.cache
def import_statements(path: Path, written_ns: int) -> list[ast.Import | ast.ImportFrom]:
    """All imports of a file as last written, at any depth."""
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    return [node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))]


def imports(module: str, path: Path, package: str) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of everything that a module imports, wherever in it, for types only included."""
    folder = f"{package}.{module}".rstrip(".").split(".")
    if path.name != "__init__.py":
        folder = folder[:-1]
    for node in import_statements(path, path.stat().st_mtime_ns):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = folder[: len(folder) - node.level + 1] if node.level else []
            origin = ".".join([*base, *filter(None, [node.module])])
            # `from lgmpc import wbc` names a subpackage; `from lgmpc.wbc import x` may name no module, but its parent.
            yield from ((node.lineno, f"{origin}.{alias.name}") for alias in node.names)


def row(module: str, table: dict[str, str]) -> str | None:
    """The entry of the module itself, or of the nearest package around it."""
    while module and module not in table:
        module = module.rpartition(".")[0] if "." in module else ""
        if not module:
            return None
    return table.get(module)


def inside(module: str, subpackages: str) -> bool:
    return any(module == subpackage or module.startswith(f"{subpackage}.") for subpackage in subpackages.split())


def offences(package: Path) -> list[str]:
    """Every import that the tables forbid, as ``module:line imports name``."""
    found = []
    for module, path in modules(package):
        allowed = row(module, ARROWS)
        own = module.partition(".")[0]
        if allowed is None:
            found.append(f"{module} belongs to no subpackage in the table")
            continue
        foundation = "" if inside(module, FOUNDATION) or module == "" else FOUNDATION
        for line, name in imports(module, path, package.name):
            outside, _, within = name.partition(".")
            if outside == package.name:
                subpackage = within.partition(".")[0]
                fine = subpackage == own or subpackage.startswith("__") or inside(within, f"{allowed} {foundation}")
            else:
                fine = outside not in OWNERS or inside(module, OWNERS[outside])
            if not fine:
                found.append(f"{module or package.name}:{line} imports {name}")
    return found


def test_no_arrow_points_the_wrong_way() -> None:
    assert offences(PACKAGE) == []


def test_every_module_was_read() -> None:
    names = dict(modules(PACKAGE))
    assert {"", "errors", "compile", "compile.native", "doctor"} <= set(names)
    seen = {name for module, path in names.items() for _, name in imports(module, path, "lgmpc")}
    assert {"lgmpc.errors.InputError", "lgmpc.compile.kernel.StageKernel", "casadi"} <= seen


def test_the_table_has_no_cycle() -> None:
    subpackages: dict[str, set[str]] = {}
    for module, allowed in ARROWS.items():
        own = module if module == "control.interface" else module.partition(".")[0]
        foundation = set() if inside(module, FOUNDATION) or module == "" else set(FOUNDATION.split())
        subpackages.setdefault(own, set()).update(set(allowed.split()) | foundation)
    order = list(graphlib.TopologicalSorter(subpackages).static_order())
    chain = ["lie", "state", "robot", "costs", "actions", "ocp", "solvers", "mpc", "control", "config", "cli"]
    assert [subpackage for subpackage in order if subpackage in chain] == chain


def test_no_packages_within_a_subpackage_import_each_other_in_a_circle() -> None:
    """The packages within a subpackage have no cycle either."""
    packages = {module for module, path in modules(PACKAGE) if path.name == "__init__.py" and module.count(".") == 1}
    assert {"robot.symbolic", "solvers.qp"} <= packages
    graph: dict[str, set[str]] = {name: set() for name in packages}
    for module, path in modules(PACKAGE):
        importer = ".".join(module.split(".")[:2])
        for _, target in imports(module, path, "lgmpc"):
            imported = ".".join(target.split(".")[1:3])
            if {importer, imported} <= packages and imported != importer:
                graph[importer].add(imported)
    assert len(list(graphlib.TopologicalSorter(graph).static_order())) == len(packages)  # CycleError names a circle


def test_no_modules_import_each_other_in_a_circle() -> None:
    """For types neither, but for two: messages of settings, and an update in C, of what owns it."""
    known = {("settings", "settings.messages"), ("mpc.compiled", "mpc.centroidal")}
    named = dict(modules(PACKAGE))
    graph: dict[str, set[str]] = {module: set() for module in named}
    for module, path in named.items():
        for _, target in imports(module, path, "lgmpc"):
            outside, _, target = target.partition(".")
            while target and target not in named:
                target = target.rpartition(".")[0]
            if (
                outside == "lgmpc"
                and target
                and target != module
                and (module, target) not in known
                and not module.startswith(f"{target}.")
            ):
                graph[module].add(target)
    assert len(list(graphlib.TopologicalSorter(graph).static_order())) == len(named)  # CycleError names a circle


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("lie/so3.py", "from lgmpc.robot import Robot"),
        ("lie/so3.py", "from lgmpc import wbc"),
        ("lie/so3.py", "import lgmpc.mpc.plan as plan"),
        ("lie/symbolic/so3.py", "from ...state import base"),
        ("state/__init__.py", "from ..robot.model import Robot"),
        ("robot/model.py", "def late():\n    from lgmpc.simulation import loop"),
        ("wbc/tasks.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from lgmpc.mpc import plan"),
        ("simulation/loop.py", "from lgmpc.wbc import controller"),
        ("simulation/loop.py", "from lgmpc.control import legged"),
        ("control/legged.py", "from lgmpc.simulation import loop"),
        ("control/interface.py", "from lgmpc.wbc import controller"),
        ("mechanics/tops.py", "from lgmpc.state import base"),
        ("config/yaml_text.py", "from lgmpc.robot import Robot"),
        ("compile/native.py", "from lgmpc.lie import so3"),
        ("errors.py", "from lgmpc.typing import Array"),
        ("typing.py", "import lgmpc.compile"),
        ("__init__.py", "from lgmpc.viz import replay"),
        ("simulation/loop.py", "import mujoco"),
        ("wbc/solver.py", "from matplotlib import pyplot"),
        ("solvers/fddp.py", "import crocoddyl"),
        ("runs/log.py", "import rich.console"),
        ("attic/old.py", "import numpy"),
    ],
)
def test_a_forbidden_import_is_found(module: str, line: str, tmp_path: Path) -> None:
    path = tmp_path / "lgmpc" / module
    path.parent.mkdir(parents=True)
    path.write_text(f"import numpy\n{line}\n")
    assert len(offences(tmp_path / "lgmpc")) == 1


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("state/multibody.py", "from lgmpc.lie import so3"),
        ("state/multibody.py", "from .base import State"),
        ("ocp/problem.py", "from ..compile import StageKernel"),
        ("mpc/plan.py", "from lgmpc import errors, solvers"),
        ("simulation/mujoco.py", "import mujoco"),
        ("config/build.py", "from lgmpc.control import legged"),
        ("simulation/loop.py", "from lgmpc.control.interface import Command"),
        ("cli/app.py", "from lgmpc import __version__"),
    ],
)
def test_an_allowed_import_is_not_reported(module: str, line: str, tmp_path: Path) -> None:
    path = tmp_path / "lgmpc" / module
    path.parent.mkdir(parents=True)
    path.write_text(f"{line}\n")
    assert offences(tmp_path / "lgmpc") == []


def test_computing_loads_no_viewer_and_no_physics_engine() -> None:
    subpackages = [
        subpackage
        for subpackage in COMPUTING.split()
        if (PACKAGE / subpackage).exists() or (PACKAGE / f"{subpackage}.py").exists()
    ]
    assert {"compile", "lie", "robot", "simulation"} <= set(subpackages)
    script = f"""
import importlib, sys
for name in ["lgmpc", *("lgmpc." + subpackage for subpackage in {subpackages!r})]:
    importlib.import_module(name)
    loaded = [heavy for heavy in {HEAVY!r} if heavy in sys.modules]
    if loaded:
        sys.exit(f"import {{name}} loads {{loaded}}")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_no_module_is_too_long() -> None:
    lengths = {module: len(path.read_text(encoding="utf-8").splitlines()) for module, path in modules(PACKAGE)}
    assert {module: length for module, length in lengths.items() if length > LONGEST_MODULE} == {}


def test_the_package_does_not_grow() -> None:
    lengths = [len(path.read_text(encoding="utf-8").splitlines()) for _, path in modules(PACKAGE)]
    assert sum(lengths) <= MOST_LINES and len(lengths) <= MOST_FILES


def test_runs_are_judged_along_the_normals_of_the_ground() -> None:
    """No z of a force, a foot or a base stands for its part along the normal, or for its height above the ground."""
    vertical = re.compile(r"\b(contact_points|contact_forces\w*|base_pose|push)\[[^]]*[ ,]2(:3)?\]")
    found = [
        f"{module}: {match.group()}"
        for module, path in modules(PACKAGE)
        if inside(module, "runs simulation config")
        for match in vertical.finditer(path.read_text(encoding="utf-8"))
    ]
    assert found == []
    knowing = {module for module, path in modules(PACKAGE / "runs") if "radius *" in path.read_text(encoding="utf-8")}
    assert knowing == {"ground"}


def test_feet_know_where_they_touch() -> None:
    """Outside of robot/ nothing reads a robot's radius of contact, or goes down by it: ``robot.foot_points`` does."""
    down = re.compile(r"robot\.contact_radius|\be_z\b|- radius \* |0\.0, 0\.0, -?radius\]")
    found = {
        module: match.group()
        for module, path in modules(PACKAGE)
        for match in down.finditer(path.read_text(encoding="utf-8"))
        if not inside(module, "robot runs.ground")
    }
    assert found == {}
    assert down.search((PACKAGE / "robot" / "contact_points.py").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("formula", "place"), [(r"10\.0 [-+] (15|\w \* \(6)", "timegrid"), (r"\b9\.81\b", "typing")])
def test_minimum_jerk_and_gravity_are_written_once(formula: str, place: str) -> None:
    found = {module for module, path in modules(PACKAGE) if re.search(formula, path.read_text(encoding="utf-8"))}
    assert found == {place}
