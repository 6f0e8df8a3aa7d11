"""Actions: models of one interval of an optimal control problem, as CasADi expressions."""

from lgmpc.actions.base import Action as Action, Stage as Stage, StageValue as StageValue
from lgmpc.actions.centroidal import CentroidalAction as CentroidalAction
from lgmpc.actions.contacts import Contact as Contact
from lgmpc.actions.dynamics import (
    ContactForwardDynamics as ContactForwardDynamics,
    Dynamics as Dynamics,
    ExternalWrench as ExternalWrench,
    FreeForwardDynamics as FreeForwardDynamics,
)
from lgmpc.actions.free_duration import ChooseStretch as ChooseStretch, Stretched as Stretched
from lgmpc.actions.implicit import Unknowns as Unknowns
from lgmpc.actions.integrators import (
    Integrator as Integrator,
    RungeKutta4 as RungeKutta4,
    SemiImplicitEuler as SemiImplicitEuler,
    Variational as Variational,
)
from lgmpc.actions.multibody import (
    HoldAction as HoldAction,
    ImpulseAction as ImpulseAction,
    MultibodyAction as MultibodyAction,
    thrusters as thrusters,
)
from lgmpc.actions.penalized import PenalizedAction as PenalizedAction, penalize as penalize
from lgmpc.actions.python_action import (
    Limits as Limits,
    PythonAction as PythonAction,
    StageDerivatives as StageDerivatives,
)
