"""Actions: models of one interval of an optimal control problem, as CasADi expressions."""

from lgmpc.actions.base import Action, Stage, StageValue
from lgmpc.actions.centroidal import CentroidalAction
from lgmpc.actions.contacts import Contact
from lgmpc.actions.dynamics import (
    ContactForwardDynamics,
    Dynamics,
    ExternalWrench,
    FreeForwardDynamics,
    Load,
    Motion,
)
from lgmpc.actions.free_duration import ChooseStretch, Stretched
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.integrators import Integrator, RungeKutta4, SemiImplicitEuler, Variational
from lgmpc.actions.multibody import HoldAction, ImpulseAction, MultibodyAction, thrusters
from lgmpc.actions.penalized import PenalizedAction, penalize
from lgmpc.actions.python_action import Limits, PythonAction, StageDerivatives
from lgmpc.costs import Bounded, Cost, CostTerm, LeastSquares, Parameter, ParameterLayout

__all__ = [
    "Action",
    "Bounded",
    "CentroidalAction",
    "ChooseStretch",
    "Contact",
    "ContactForwardDynamics",
    "Cost",
    "CostTerm",
    "Dynamics",
    "ExternalWrench",
    "FreeForwardDynamics",
    "HoldAction",
    "ImpulseAction",
    "Integrator",
    "LeastSquares",
    "Limits",
    "Load",
    "Motion",
    "MultibodyAction",
    "Parameter",
    "ParameterLayout",
    "PenalizedAction",
    "PythonAction",
    "RungeKutta4",
    "SemiImplicitEuler",
    "Stage",
    "StageDerivatives",
    "StageValue",
    "Stretched",
    "Unknowns",
    "Variational",
    "penalize",
    "thrusters",
]
