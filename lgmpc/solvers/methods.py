"""The table of trajectory solvers: the method by which a config selects each, its settings, and its class.

A new solver is a module with its settings, which include ``method: Literal[...]``, its class, and one line in the
table.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from lgmpc.ocp import ShootingProblem
from lgmpc.settings import one_of
from lgmpc.solvers.augmented_lagrangian import AugmentedLagrangianFddp, AugmentedLagrangianSettings
from lgmpc.solvers.box import BoxFddp, bounded_rows
from lgmpc.solvers.fddp import Fddp, FddpSettings, check_unconstrained
from lgmpc.solvers.line_search_sqp import LineSearchSqp, LineSearchSqpSettings
from lgmpc.solvers.loop import Solver, SolverSettings
from lgmpc.solvers.nlp import NlpSettings, NlpSolver
from lgmpc.typing import instance

_METHODS: Mapping[str, tuple[type[SolverSettings], Callable[..., Solver]]] = {
    "fddp": (FddpSettings, Fddp),
    "box_fddp": (FddpSettings, BoxFddp),
    "al_fddp": (AugmentedLagrangianSettings, AugmentedLagrangianFddp),
    "sqp": (LineSearchSqpSettings, LineSearchSqp),
    "ipopt": (NlpSettings, NlpSolver),
    "fatrop": (NlpSettings, NlpSolver),
}


_CONSTRAINTS: Mapping[str, Callable[[ShootingProblem], object]] = {
    "fddp": check_unconstrained,
    "box_fddp": bounded_rows,
}
"""Raise for path constraints that a method does not support; the other methods support any."""


def check_method(problem: ShootingProblem, settings: SolverSettings) -> None:
    """Raise what :func:`make_solver` raises, without building a solver.

    Raises:
        InputError: the method does not support the problem's path constraints.
    """
    instance("problem", problem, ShootingProblem, "a ShootingProblem")
    instance("settings", settings, SolverSettings, "settings of a solver, as FddpSettings()")
    if settings.method in _CONSTRAINTS:
        _CONSTRAINTS[settings.method](problem)


def make_solver(problem: ShootingProblem, settings: SolverSettings) -> Solver:
    """Return the solver that ``settings.method`` names.

    Args:
        problem: the problem; its data are read at every solve.
        settings: method, tolerances and limits.

    Raises:
        InputError: the method does not support the problem's path constraints.
    """
    instance("settings", settings, SolverSettings, "settings of a solver, as FddpSettings()")
    _, kind = _METHODS[settings.method]
    return kind(problem, settings)


if TYPE_CHECKING:
    AnySolverSettings = SolverSettings
else:
    AnySolverSettings = one_of({method: settings for method, (settings, _) in _METHODS.items()}, "method")
    """The settings of one solver, selected by the key ``method``."""
