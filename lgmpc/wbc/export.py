"""The whole-body tick as a C library: for robots whose computer has no Python.

:func:`write_tick_library` writes a folder that needs a C compiler and CMake only: the compiled functions' sources, a
header with sizes, order and units, recorded ticks, and a program that solves them again and compares.
"""

import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.compile import densify_function
from lgmpc.compile.image import write_exported
from lgmpc.compile.simd import generate_simd
from lgmpc.errors import InputError
from lgmpc.robot.friction import facet_normals, pyramid_half_width
from lgmpc.status import Status
from lgmpc.typing import Array
from lgmpc.wbc.assembly import quadratic_programme
from lgmpc.wbc.controller import WholeBodyController
from lgmpc.wbc.solver import MOST_STEPS
from lgmpc.wbc.tasks import Task

_CONSTANT = ("limits", "weights")
_MEANINGS = {
    "q": "configuration: base position (m) and quaternion x y z w, joint angles (rad)",
    "v": "velocity: base linear (m/s) and angular (rad/s), base axes; joint rates (rad/s)",
    "stance": "1 for contact points that carry, else 0",
    "normals": "unit normals of the surfaces under the contact points, world axes",
    "target_forces": "reference of the contact forces, world axes, on the robot, N",
    "lowest_normal": "normal force that each foot in contact keeps, N",
    "highest_normal": "normal force that each foot in contact may reach, N",
    "external_wrench": "force and moment about the centre of mass on the base, world axes, N and N.m",
    "horizon": "look-ahead of the joints' limits, s; largest acceleration that they require, rad/s2",
    "joint_load": "known or estimated torques on the legs of what pushes them, N.m",
    "joint_friction": "Coulomb friction of the joints that the torques overcome, N.m",
}


class TickRecorder:
    """Records inputs and results of a controller's ticks, from the next one on.

    Args:
        wbc: the controller.

    Raises:
        InputError: it has a task in Python, or ``proxqp`` as its only solver.
    """

    def __init__(self, wbc: WholeBodyController) -> None:
        for task in wbc.qp.numeric:
            raise InputError("wbc.tasks", f"'{task.name}' in Python", "tasks written as expressions (SymbolicTask)")
        if wbc.settings.solver != "active_set":
            raise InputError("wbc.solver", wbc.settings.solver, "active_set, which is a C source of lgmpc's own")
        self._wbc, self._solve = wbc, wbc.solve
        self._ticks: list[Array] = []
        wbc.solve = self._record  # type: ignore[method-assign]

    @property
    def ticks(self) -> Array:
        """(n, size) flag of a fresh start, inputs, status and results of each tick."""
        return np.array(self._ticks)

    def _record(self) -> Status:
        wbc = self._wbc
        fresh, given = wbc.solver.active == 0, [*variables(wbc).values(), wbc.contacts.friction]
        before = np.concatenate([[fresh], *(np.ravel(each) for each in given)])
        status = self._solve()
        code = 2 if status is Status.NOT_FINITE else int(wbc.solver.took_over)
        self._ticks.append(np.concatenate([before, [code], wbc.tau, wbc.forces.ravel(), wbc.acceleration]))
        return status


def variables(wbc: WholeBodyController) -> dict[str, Array]:
    """Return the buffers that a tick reads, by name and in the order of the function; those of tasks by the task's."""
    names = {f"task_{i}": _field(task) for i, task in enumerate(wbc.qp.symbolic)}
    flags = {"stance": wbc.contacts.stance.astype(np.float64)}
    return {names.get(name, name): each for name, each in (wbc.qp.inputs | flags).items() if name not in _CONSTANT}


def write_tick_library(wbc: WholeBodyController, ticks: Array, folder: Path) -> None:
    """Write sources, header, build file and recorded ticks.

    Args:
        wbc: the controller.
        ticks: of a :class:`TickRecorder`.
        folder: created unless it exists.

    Raises:
        InputError: the folder is not empty.
    """
    if folder.exists() and any(folder.iterdir()):
        raise InputError("--c", str(folder), "a new or an empty folder")
    folder.mkdir(parents=True, exist_ok=True)
    function = densify_function(quadratic_programme(wbc.robot, wbc.qp.symbolic))
    parts = {f"data_{i}.c": part for i, part in enumerate(generate_simd(function, lanes=False))}
    own = {name: (files("lgmpc.wbc") / name).read_text("utf-8") for name in ("tick.c", "active_set.c")}
    texts = parts | own | {"lgmpc_tick.h": _header(wbc), "constants.h": _constants(wbc)}
    write_exported(folder, "lgmpc_tick", texts, _REPLAYED, ticks)


def _header(wbc: WholeBodyController) -> str:
    robot, tasks = wbc.robot, {_field(task): task for task in wbc.qp.symbolic}
    fields = []
    for name, buffer in variables(wbc).items():
        meaning = _layout(tasks[name]) if name in tasks else _MEANINGS[name]
        fields.append(f"  double {name}[{buffer.size}]; /* {meaning} */")
    fields.append(f"  double friction[{robot.nc}]; /* assumed Coulomb coefficient at each contact point */")
    joints, points = ", ".join(robot.joint_names), ", ".join(map(str, robot.contact_frames))
    return files("lgmpc.wbc").joinpath("tick.h").read_text("utf-8").format(
        robot=robot.name, joints=joints, points=points, inputs="\n".join(fields),
        nu=robot.nu, nv=robot.nv, forces=3 * robot.nc, tasks=len(tasks),
    )  # fmt: skip


def _field(task: Task) -> str:
    return "task_" + re.sub(r"\W", "_", task.name)


def _layout(task: Task) -> str:
    return "; ".join(f"{p.name} ({p.size}): {p.meaning}" for p in task.layout.parameters)


def _constants(wbc: WholeBodyController) -> str:
    robot, facets, patches = wbc.robot, wbc.qp.facets, wbc.robot.foot_points
    sizes: Mapping[str, int] = {
        "NU": robot.nu, "NV": robot.nv, "NC": robot.nc, "NB": robot.nv - robot.nu, "NX": wbc.solver.size,
        "ROWS": len(wbc.solver.lower), "FACETS": facets, "SOLES": 0 if patches.single else robot.nf,
        "MOST_STEPS": MOST_STEPS,
    }  # fmt: skip
    arrays: Mapping[str, Any] = {
        "LIMITS": wbc.qp.inputs["limits"], "WEIGHTS": wbc.qp.inputs["weights"],
        "FACET_NORMALS": facet_normals(facets).ravel(),
    }  # fmt: skip
    starts = [*patches.starts.tolist(), robot.nc]
    lines = ["/* Sizes and constants of the controller. */", "enum {"]
    lines += [f"  {name} = {value}," for name, value in sizes.items()]
    lines += [
        "};",
        f"#define HALF_WIDTH {pyramid_half_width(1.0, facets)!r}",
        f"#define TOLERANCE {wbc.settings.tolerance!r}",
    ]
    lines += [
        _array("int", "POINTS", starts),
        _array("int", "TASK_SIZES", [each.layout.size for each in wbc.qp.symbolic]),
    ]
    lines += [_array("double", name, values.tolist()) for name, values in arrays.items()]
    return "\n".join(lines) + "\n"


def _array(kind: str, name: str, values: Iterable[float]) -> str:
    return f"static const {kind} {name}[] = {{{', '.join(map(repr, values)).replace('inf', 'INFINITY')}}};"


_REPLAYED = {
    "INPUTS": "lgmpc_inputs", "OUTPUTS": "lgmpc_outputs", "MEMORY": "lgmpc_tick", "CREATE": "lgmpc_tick_create",
    "RESET": "lgmpc_tick_reset", "CALL": "lgmpc_tick_solve", "DESTROY": "lgmpc_tick_destroy",
    "COMPARED(x)": "x.torques", "CALLS": '"ticks"', "RESULTS": '"torques"',
}  # fmt: skip
