"""The centroidal MPC's update as a C library, beside that of the whole-body tick (:mod:`lgmpc.wbc.export`).

Its functions are those that Python calls, its memory is that of the controller before its first update, and
``update.c`` makes the same calls in the same order.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.compile import EXACT, frame_of, sequence_of
from lgmpc.compile.compiler import FLAGS
from lgmpc.compile.image import image_sources
from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.centroidal import CentroidalMpc
from lgmpc.mpc.interface import MeasuredState, Mpc
from lgmpc.mpc.plan import MpcStatus, Plan
from lgmpc.solvers.qp import ActiveSetSolver
from lgmpc.solvers.qp.active_set import ROW_METHODS
from lgmpc.typing import Array

_PLACES = (
    "contact_points", "contact_normals", "contact_flags", "friction", "external_wrench", "x_reference", "x_weight",
    "u_reference",
)  # fmt: skip


class UpdateRecorder:
    """Writes the library of a controller, and records its updates from now on.

    Updates are recorded until one that the C library cannot make: a solve by the standard fallback, or one from a state
    that was set (forecasts of steps).

    Args:
        mpc: the controller, before its first update.

    Raises:
        InputError: it is another kind of controller, or its problem has stages for dense blocks.
    """

    def __init__(self, mpc: Mpc | None) -> None:
        if not isinstance(mpc, CentroidalMpc):
            raise InputError("mpc.model", type(mpc).__name__, "centroidal, whose update can be written in C")
        solver = mpc.solver.qp_solver
        if not isinstance(solver, ActiveSetSolver) or not solver.available:
            raise InputError("mpc.qp_solver", mpc.settings.qp_solver, "active_set, which is a C source of lgmpc's own")
        if not solver.scalar:
            raise InputError("robot.feet", f"{mpc.problem.nu // 3} points", "few enough for scalar code: no soles")
        self._mpc, self._update, self._set_state = mpc, mpc.update, mpc.set_state
        self._sources = image_sources(_root(mpc, solver))
        self._updates: list[Array] = []
        self._open = True
        mpc.update = self._record  # type: ignore[method-assign]
        mpc.set_state = self._end  # type: ignore[method-assign]

    @property
    def updates(self) -> Array:
        """(n, size) flag of a start without a guess, inputs, status and plan of each update."""
        return np.array(self._updates)

    def write(self, folder: Path) -> None:
        """Write the library with the recorded updates into a new folder."""
        folder.mkdir(parents=True)
        s, contacts = self._mpc.settings, self._mpc.problem.nu // 3
        methods = (files("lgmpc.solvers.qp").joinpath(f"{name}.c").read_text("utf-8") for name in ROW_METHODS)
        own_files = files("lgmpc.mpc")
        update = (EXACT, *methods, own_files.joinpath("update.c").read_text("utf-8"))
        texts = {**self._sources, "update.c": "".join(update)}
        texts["lgmpc_mpc.h"] = _HEADER.format(
            nodes=s.nodes, points=contacts, node_s=s.node_s, mass=self._mpc.mass, rate=s.rate_hz
        )
        texts["replay_mpc.c"] = own_files.joinpath("replay_mpc.c").read_text("utf-8")
        own = " ".join(name for name in texts if name.endswith(".c") and name != "replay_mpc.c")
        flags = " ".join(flag for flag in FLAGS if flag not in ("-fPIC", "-shared"))
        texts["CMakeLists.txt"] = _BUILD.format(own=own, flags=flags)
        for name, text in texts.items():
            (folder / name).write_text(text, "utf-8")
        self.updates.astype("<f8").tofile(folder / "updates.bin")

    def _record(
        self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array
    ) -> Plan:
        mpc = self._mpc
        legs = np.zeros_like(reference.com) if reference.legs is None else reference.legs
        given = (
            mpc._guess_time is None, state.time, state.com, state.momentum, state.rotation, state.inertia,
            contacts.points, contacts.normals, contacts.flags, contacts.friction, wrench, reference.com,
            reference.com_velocity, reference.angular_velocity, reference.q[0, 3:7], reference.catching,
            reference.legs is not None, legs,
        )  # fmt: skip
        before = np.concatenate([np.ravel(each).astype(np.float64) for each in given])
        plan = self._update(state, contacts, reference, wrench)
        code = 0 if plan.status.fresh else 2 if plan.status is MpcStatus.NOT_FINITE else 1
        self._open = self._open and not mpc.solver.qp_solver.took_over  # type: ignore[attr-defined]
        if self._open:
            self._updates.append(np.concatenate([before, [code, plan.time], plan.xs.ravel(), plan.forces.ravel()]))
        return plan

    def _end(self, state: Any) -> None:
        self._open = False
        self._set_state(state)


def _root(mpc: CentroidalMpc, qp: ActiveSetSolver) -> Any:
    """Return the addresses of all that an update reads and writes, in the order of ``update.c``."""
    sqp, problem, reference, s = mpc.solver, mpc.problem, mpc._reference, mpc.settings
    f, step, places = sqp._functions, qp.solution, problem.action.parameters
    moves, refers = (sqp._move, *sqp._shifts), (reference._turn, reference._run)
    plan = np.array(
        [
            problem.parameters.shape[1], s.sqp_iterations, s.stale_after, len(refers), len(moves), len(f._calls),
            *(places[name].start for name in _PLACES),
        ]
    )  # fmt: skip
    return frame_of(
        plan, np.array([s.node_s, *mpc._weight]), problem.parameters, problem.x0, sqp.xs, sqp.us, f.xs_base, f.dxs,
        sqp._fraction, sqp._x0, sqp._dx0, qp.first, *step.arrays, *reference._motion, reference._attitude,
        reference._rotation, reference._inertia, mpc._standing_weight, mpc._stepping_weight, mpc._catching_weight,
        np.zeros_like(sqp.xs), np.zeros_like(sqp.us), np.array([np.nan, np.nan, 0.0]), sequence_of(*refers),
        sequence_of(*moves), sequence_of(*f._calls), sequence_of(sqp._subtract), sequence_of(f._retract), qp.frame,
    )  # fmt: skip


_HEADER = """\
/* One update of the predictive controller: measured momenta and horizon in, forces of {nodes} intervals out. Written by
   lgmpc.

   The horizon has {nodes} intervals of {node_s:g} s; the recorded controller planned {rate:g} times a second, for a
   mass of {mass:.6g} kg. Contacts and the wrench are those of the intervals, references those of the nodes, one more.
   World axes unless said otherwise. */
#ifndef LGMPC_MPC_H
#define LGMPC_MPC_H

enum {{ LGMPC_MPC_NODES = {nodes}, LGMPC_MPC_POINTS = {points} }};
enum {{ LGMPC_MPC_SOLVED, LGMPC_MPC_NOT_SOLVED, LGMPC_MPC_NOT_FINITE }};

typedef struct {{
  double time;         /* s */
  double com[3];       /* measured centre of mass, m */
  double momentum[6];  /* measured, linear N.s, angular about the centre of mass N.m.s */
  double rotation[9];  /* of the base to the world, row by row */
  double inertia[9];   /* about the centre of mass, from the base's axes to the world's, kg.m2, row by row */
  double points[{nodes}][{points}][3];  /* contact points, m; of a foot in the air, where it will touch down next */
  double normals[{nodes}][{points}][3]; /* of the surfaces there, unit length */
  double flags[{nodes}][{points}];      /* 1 for points that carry, else 0 */
  double friction[{nodes}][{points}];   /* Coulomb coefficients to rely on */
  double wrench[{nodes}][6];      /* external force, N, and moment about the centre of mass, N.m */
  double com_reference[{nodes} + 1][3];              /* m */
  double com_velocity_reference[{nodes} + 1][3];     /* m/s */
  double angular_velocity_reference[{nodes} + 1][3]; /* of the base, rad/s */
  double attitude_reference[4]; /* of the base at the first node, quaternion x y z w */
  double catching;              /* 1 while steps catch a push, else 0 */
  double legs_given;            /* 1 if the next are used, else 0 */
  double legs[{nodes} + 1][3];  /* angular momentum of the legs' motion beside the base's, N.m.s */
}} lgmpc_mpc_inputs;

typedef struct {{
  double time;                   /* of the first node, s */
  double states[{nodes} + 1][9]; /* centre of mass, m; linear momentum, N.s; angular momentum, N.m.s */
  double forces[{nodes}][{points}][3];   /* at the contact points, on the robot, N */
}} lgmpc_mpc_plan;

typedef void lgmpc_mpc;

/* Memory of a controller; 0 if there is none. No other function allocates. */
lgmpc_mpc* lgmpc_mpc_create(void);
void lgmpc_mpc_destroy(lgmpc_mpc*);

/* Start the next update at rest instead of from the last plan. */
void lgmpc_mpc_reset_guess(lgmpc_mpc*);

/* Plan. Unless LGMPC_MPC_SOLVED is returned the plan is as it was: follow it further, for half its horizon at most. */
int lgmpc_mpc_update(lgmpc_mpc*, const lgmpc_mpc_inputs*, lgmpc_mpc_plan*);

#endif
"""

_BUILD = """\
# Part of the folder above, or by itself: cmake -B build && cmake --build build && ctest --test-dir build
cmake_minimum_required(VERSION 3.10)
project(lgmpc_mpc C)
enable_testing()
# The flags of lgmpc itself: with them, and for the same processor, results are the same bits.
option(NATIVE "Compile for this computer's processor" ON)
add_compile_options({flags} $<$<BOOL:${{NATIVE}}>:-march=native>)
add_library(lgmpc_mpc STATIC {own})
target_include_directories(lgmpc_mpc PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
target_link_libraries(lgmpc_mpc PUBLIC m)
add_executable(replay_mpc replay_mpc.c)
target_link_libraries(replay_mpc lgmpc_mpc)
add_test(NAME replay_mpc COMMAND replay_mpc ${{CMAKE_CURRENT_SOURCE_DIR}}/updates.bin)
"""
