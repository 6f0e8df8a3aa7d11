"""The centroidal MPC's update as a C library, beside that of the whole-body tick (:mod:`lgmpc.wbc.export`).

It is the machine code of Python's own updates (:mod:`lgmpc.mpc.compiled`); its memory is that of the controller before
its first update.
"""

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.compile.image import image_sources, write_exported
from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.centroidal import CentroidalMpc
from lgmpc.mpc.compiled import NOT_FINITE, NOT_SOLVED, SOLVED, header, update_source
from lgmpc.mpc.interface import MeasuredState, Mpc
from lgmpc.mpc.plan import Plan
from lgmpc.solvers.qp import ActiveSetSolver
from lgmpc.status import Status
from lgmpc.typing import Array


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
        assert mpc._compiled is not None
        self._mpc, self._update, self._set_state, self._compiled = mpc, mpc.update, mpc.set_state, mpc._compiled
        self._sources = image_sources(self._compiled.frame)
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
        s = self._mpc.settings
        update = update_source('#include "lgmpc_mpc.h"\n') + files("lgmpc.mpc").joinpath("library.c").read_text("utf-8")
        recorded = (
            f"/* {s.nodes} intervals of {s.node_s:g} s, {s.rate_hz:g} plans a second, {self._mpc.mass:.6g} kg */\n"
        )
        texts = {**self._sources, "update.c": update, "lgmpc_mpc.h": recorded + header(self._mpc)}
        write_exported(folder, "lgmpc_mpc", texts, _REPLAYED, self.updates)

    def _record(
        self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array
    ) -> Plan:
        mpc, compiled = self._mpc, self._compiled
        fresh = mpc._guess_time is None
        plan = self._update(state, contacts, reference, wrench)
        code = SOLVED if plan.status.usable else NOT_FINITE if plan.status is Status.NOT_FINITE else NOT_SOLVED
        self._open = self._open and not mpc.solver.qp_solver.took_over  # type: ignore[attr-defined]
        if self._open:
            made = [code, plan.time], plan.xs.ravel(), plan.forces.ravel()
            self._updates.append(np.concatenate([[fresh], compiled.given, *made]))
        return plan

    def _end(self, state: Any) -> None:
        self._open = False
        self._set_state(state)


_REPLAYED = {
    "INPUTS": "lgmpc_mpc_inputs", "OUTPUTS": "lgmpc_mpc_plan", "MEMORY": "lgmpc_mpc", "CREATE": "lgmpc_mpc_create",
    "RESET": "lgmpc_mpc_reset_guess", "CALL": "lgmpc_mpc_update", "DESTROY": "lgmpc_mpc_destroy",
    "COMPARED(x)": "x", "CALLS": '"updates"', "RESULTS": '"plans"',
}  # fmt: skip
