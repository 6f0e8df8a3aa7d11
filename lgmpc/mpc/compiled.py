"""The centroidal MPC's update in one call of machine code, on the memory of the controller in Python."""

import ctypes
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from lgmpc.compile import EXACT, compile_source, frame_of, sequence_of
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.interface import MeasuredState
from lgmpc.solvers.qp import ActiveSetSolver
from lgmpc.solvers.qp.active_set import ROW_METHODS
from lgmpc.typing import Array

if TYPE_CHECKING:
    from lgmpc.mpc.centroidal import CentroidalMpc

SOLVED, NOT_SOLVED, NOT_FINITE, OVERFLOWN = range(4)
"""Results of an update: NOT_SOLVED leaves the rest to the standard fallbacks."""
_GUESSED, _FACTORISATIONS = 0, 3  # in the state of update.c
_PLACES = (
    "contact_points", "contact_normals", "contact_flags", "friction", "external_wrench", "x_reference", "x_weight",
    "u_reference",
)  # fmt: skip


class CompiledUpdate:
    """The update of a controller of point feet, by ``update.c``: the same calls in the same order, the same bits.

    Args:
        mpc: the controller.
        solver: of its subproblems.
        library: machine code of :func:`update_source`.

    Attributes:
        frame: addresses of all that an update reads and writes, in the order of ``update.c``.
        given: the last update's inputs, in the order of ``lgmpc_mpc.h``.
        states: (N+1, 9) the last plan's centre of mass, linear and angular momentum.
        forces: (N, nc, 3) its contact forces, N.
    """

    def __init__(self, mpc: "CentroidalMpc", solver: ActiveSetSolver, library: ctypes.CDLL) -> None:
        n, points, self._solver = mpc.settings.nodes, mpc.problem.nu // 3, solver
        nodes, intervals = n + 1, (n, points)
        shapes = (
            (1,), (3,), (6,), (3, 3), (3, 3), (*intervals, 3), (*intervals, 3), intervals, intervals, (n, 6),
            (nodes, 3), (nodes, 3), (nodes, 3), (4,), (2,), (nodes, 3),
        )  # fmt: skip
        self.given, views = _packed(shapes)
        self._time, *self._arrays, self._choices, self._legs = views
        plan, (_, self.states, self.forces) = _packed(((1,), (nodes, 9), (*intervals, 3)))
        self._state = np.array([np.nan, np.nan, 0.0, 0.0])
        self.frame = _frame(mpc, solver, self._state)
        self._attempt = library.lgmpc_mpc_attempt
        self._memory = ctypes.byref(self.frame), *(ctypes.c_void_p(each.ctypes.data) for each in (self.given, plan))
        self._plan = plan

    @classmethod
    def of(cls, mpc: "CentroidalMpc") -> "CompiledUpdate | None":
        """Return the update of a controller; None with another QP solver, for soles, and without a compiler."""
        solver = mpc.solver.qp_solver
        if not isinstance(solver, ActiveSetSolver) or not (solver.available and solver.scalar):
            return None
        library = compile_source("lgmpc_mpc_update", update_source(header(mpc)))
        return None if library is None else cls(mpc, solver, library)

    def write(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> None:
        """Write the inputs of an update.

        Raises:
            ValueError: an array of the wrong shape.
        """
        given = (
            state.com, state.momentum, state.rotation, state.inertia, contacts.points, contacts.normals, contacts.flags,
            contacts.friction, wrench, reference.com, reference.com_velocity, reference.angular_velocity,
            reference.q[0, 3:7],
        )  # fmt: skip
        for mine, theirs in zip(self._arrays, given, strict=True):
            if theirs.shape != mine.shape:
                raise ValueError(f"shape {theirs.shape} instead of {mine.shape}")
            mine[...] = theirs
        self._time[0], self._choices[0] = state.time, reference.catching
        self._choices[1] = reference.legs is not None
        if reference.legs is not None:
            self._legs[...] = reference.legs

    def run(self, guess_time: float | None) -> tuple[int, int]:
        """Make the update of the inputs; return its result, and the factorisations that it took.

        Args:
            guess_time: when the last trajectory began, s; None to start at rest.
        """
        self._state[_GUESSED] = np.nan if guess_time is None else guess_time
        status = self._attempt(*self._memory)
        self._solver.took_over = False
        return status, int(self._state[_FACTORISATIONS])


def header(mpc: "CentroidalMpc") -> str:
    """Return the C header of a controller's update."""
    sizes = f"#define LGMPC_MPC_NODES {mpc.settings.nodes}\n#define LGMPC_MPC_POINTS {mpc.problem.nu // 3}\n"
    return sizes + files("lgmpc.mpc").joinpath("lgmpc_mpc.h").read_text("utf-8")


def update_source(header: str) -> str:
    """Return the C source of the update after its header, or the line that includes it."""
    methods = (files("lgmpc.solvers.qp").joinpath(f"{name}.c").read_text("utf-8") for name in ROW_METHODS)
    return "".join((EXACT, *methods, header, files("lgmpc.mpc").joinpath("update.c").read_text("utf-8")))


def _packed(shapes: tuple[tuple[int, ...], ...]) -> tuple[Array, list[Array]]:
    """Return memory, and arrays of these shapes in it, one after the other."""
    ends = np.cumsum([np.prod(shape) for shape in shapes])
    memory = np.zeros(ends[-1])
    parts = np.split(memory, ends[:-1])
    return memory, [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def _frame(mpc: "CentroidalMpc", qp: ActiveSetSolver, state: Array) -> Any:
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
        np.zeros_like(sqp.xs), np.zeros_like(sqp.us), state, sequence_of(*refers), sequence_of(*moves),
        sequence_of(*f._calls), sequence_of(sqp._subtract), sequence_of(f._retract), qp.frame,
    )  # fmt: skip
