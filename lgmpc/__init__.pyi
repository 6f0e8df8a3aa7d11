"""The public names: those of a controlled robot first, then those of optimal control problems."""

from lgmpc.control.legged import LeggedController as LeggedController
from lgmpc.control import Command as Command, Measurement as Measurement, RobotState as RobotState
from lgmpc.locomotion import MotionCommand as MotionCommand
from lgmpc.world import World as World
from lgmpc.config import load_config as load_config, load_solve_config as load_solve_config
from lgmpc.config.execution import run_config as run_config, solve_config as solve_config
from lgmpc.sweeps import load_sweep as load_sweep, run_sweep as run_sweep
from lgmpc.hardware import deploy as deploy
from lgmpc.runs import load_run as load_run
from lgmpc.live.notebook import drive as drive
from lgmpc.config.showing import (
    show as show,
    plot as plot,
    explain as explain,
    report as report,
    show_solution as show_solution,
    plot_solution as plot_solution,
)
from lgmpc.robot import Robot as Robot, RobotSpec as RobotSpec, load_robot as load_robot
from lgmpc.wbc import WholeBodyController as WholeBodyController, SymbolicTask as SymbolicTask, Gain as Gain
from lgmpc.mpc import CentroidalMpc as CentroidalMpc
from lgmpc.problems import Scenario as Scenario, GaitSettings as GaitSettings, build_gait as build_gait
from lgmpc.locomotion.sequence import GaitSequence as GaitSequence
from lgmpc.ocp import (
    ShootingProblem as ShootingProblem,
    Trajectory as Trajectory,
    check_derivatives as check_derivatives,
)
from lgmpc.actions import (
    Action as Action,
    Contact as Contact,
    ContactForwardDynamics as ContactForwardDynamics,
    FreeForwardDynamics as FreeForwardDynamics,
    HoldAction as HoldAction,
    MultibodyAction as MultibodyAction,
)
from lgmpc.costs import (
    ConstraintItem as ConstraintItem,
    CostItem as CostItem,
    Residual as Residual,
    StageSymbols as StageSymbols,
)
from lgmpc.costs.library import (
    CoMPosition as CoMPosition,
    ContactControlGravity as ContactControlGravity,
    Control as Control,
    FramePlacement as FramePlacement,
    FrictionCone as FrictionCone,
    StateError as StateError,
)
from lgmpc.solvers import (
    BoxFddp as BoxFddp,
    Fddp as Fddp,
    History as History,
    LineSearchSqp as LineSearchSqp,
    NlpSolver as NlpSolver,
    RealTimeSqp as RealTimeSqp,
    Solution as Solution,
)
from lgmpc.state import StateMultibody as StateMultibody
from lgmpc.errors import LgmpcError as LgmpcError

__version__: str
__imported_ns__: int
