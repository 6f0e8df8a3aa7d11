"""lgmpc: Lie-group trajectory optimisation and model-predictive control for floating-base robots.

The names that most programs need are here, each imported from its package on first use, so that ``import lgmpc`` is
fast. All other names are imported from their packages (``lgmpc.costs.library``).

Conventions of the whole package:

* Configuration ``q = [base position (world), quaternion x y z w, joints]``; velocity
  ``v = [base linear, base angular (both in the body frame), joint rates]``: Pinocchio's.
* State ``x = (q, v)``: ``nx = nq + nv``, ``ndx = 2 nv``. ``diff(x0, x1) = x1 (-) x0``, ``integrate(x, dx) = x (+) dx``.
* SE(3) twists and wrenches are linear first. Extended poses SE_k(3) have tangent (rotation, then a 3-vector a column).
* ``coadjoint(xi) = ad(xi)^T``; ``force_cross(xi) = -ad(xi)^T``.
* Contact forces are in world axes and act on the robot. Centroidal momentum is ``[linear; angular]`` about the centre
  of mass in world axes.
* SI units. Random numbers come only from a ``numpy.random.Generator`` that is passed in.
"""

from importlib import import_module
from time import time_ns
from typing import TYPE_CHECKING

__version__ = "0.2.0"

__imported_ns__ = time_ns()
"""When the package was imported, ns since 1970: source files that are younger may not be what was imported."""

# The public names, by the module that defines them. Type checkers and editors read the imports below instead; a test
# compares the two.
_NAMES = {
    "lgmpc.actions": ("ContactForwardDynamics", "FreeForwardDynamics", "HoldAction", "MultibodyAction"),
    "lgmpc.config": ("load_config", "load_solve_config"),
    "lgmpc.config.continuing": ("run_from",),
    "lgmpc.config.execution": ("run_config", "solve_config"),
    "lgmpc.config.showing": ("plot", "plot_solution", "show", "show_solution"),
    "lgmpc.costs": ("ConstraintItem", "CostItem", "Residual", "StageSymbols"),
    "lgmpc.costs.library": (
        "CoMPosition",
        "ContactControlGravity",
        "Control",
        "FramePlacement",
        "FrictionCone",
        "StateError",
    ),
    "lgmpc.errors": ("LgmpcError",),
    "lgmpc.locomotion.sequence": ("GaitSequence",),
    "lgmpc.mpc": ("CentroidalMpc",),
    "lgmpc.ocp": ("ShootingProblem", "Trajectory", "check_derivatives"),
    "lgmpc.problems": ("GaitSettings", "Scenario", "build_gait"),
    "lgmpc.robot": ("Robot", "RobotSpec", "load_robot"),
    "lgmpc.solvers": ("BoxFddp", "Fddp", "History", "LineSearchSqp", "NlpSolver", "RealTimeSqp", "Solution"),
    "lgmpc.state": ("StateMultibody",),
    "lgmpc.wbc": ("WholeBodyController",),
}
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

__all__ = ["__version__", *sorted(_MODULE_OF)]

if TYPE_CHECKING:
    from lgmpc.actions import ContactForwardDynamics as ContactForwardDynamics
    from lgmpc.actions import FreeForwardDynamics as FreeForwardDynamics
    from lgmpc.actions import HoldAction as HoldAction
    from lgmpc.actions import MultibodyAction as MultibodyAction
    from lgmpc.config import load_config as load_config
    from lgmpc.config import load_solve_config as load_solve_config
    from lgmpc.config.continuing import run_from as run_from
    from lgmpc.config.execution import run_config as run_config
    from lgmpc.config.execution import solve_config as solve_config
    from lgmpc.config.showing import plot as plot
    from lgmpc.config.showing import plot_solution as plot_solution
    from lgmpc.config.showing import show as show
    from lgmpc.config.showing import show_solution as show_solution
    from lgmpc.costs import ConstraintItem as ConstraintItem
    from lgmpc.costs import CostItem as CostItem
    from lgmpc.costs import Residual as Residual
    from lgmpc.costs import StageSymbols as StageSymbols
    from lgmpc.costs.library import CoMPosition as CoMPosition
    from lgmpc.costs.library import ContactControlGravity as ContactControlGravity
    from lgmpc.costs.library import Control as Control
    from lgmpc.costs.library import FramePlacement as FramePlacement
    from lgmpc.costs.library import FrictionCone as FrictionCone
    from lgmpc.costs.library import StateError as StateError
    from lgmpc.errors import LgmpcError as LgmpcError
    from lgmpc.locomotion.sequence import GaitSequence as GaitSequence
    from lgmpc.mpc import CentroidalMpc as CentroidalMpc
    from lgmpc.ocp import ShootingProblem as ShootingProblem
    from lgmpc.ocp import Trajectory as Trajectory
    from lgmpc.ocp import check_derivatives as check_derivatives
    from lgmpc.problems import GaitSettings as GaitSettings
    from lgmpc.problems import Scenario as Scenario
    from lgmpc.problems import build_gait as build_gait
    from lgmpc.robot import Robot as Robot
    from lgmpc.robot import RobotSpec as RobotSpec
    from lgmpc.robot import load_robot as load_robot
    from lgmpc.solvers import BoxFddp as BoxFddp
    from lgmpc.solvers import Fddp as Fddp
    from lgmpc.solvers import History as History
    from lgmpc.solvers import LineSearchSqp as LineSearchSqp
    from lgmpc.solvers import NlpSolver as NlpSolver
    from lgmpc.solvers import RealTimeSqp as RealTimeSqp
    from lgmpc.solvers import Solution as Solution
    from lgmpc.state import StateMultibody as StateMultibody
    from lgmpc.wbc import WholeBodyController as WholeBodyController
else:

    def __getattr__(name: str) -> object:
        """Import a public name from its module when it is first used."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'lgmpc' has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value

    def __dir__() -> list[str]:
        """Return the public names, whether they have been used or not."""
        return sorted({*globals(), *__all__})
