"""Estimation of the floating base's motion, of contacts, external wrenches and friction."""

from lgmpc.estimation.free_legs import (
    FreeLegs as FreeLegs,
    JointFrictionEstimator as JointFrictionEstimator,
    JointFrictionSettings as JointFrictionSettings,
)
from lgmpc.estimation.friction import FrictionMonitor as FrictionMonitor
from lgmpc.estimation.invariant_ekf import InvariantEkf as InvariantEkf
from lgmpc.estimation.joint_faults import (
    JointFaultMonitor as JointFaultMonitor,
    JointFaultSettings as JointFaultSettings,
)
from lgmpc.estimation.legged import (
    LeggedEstimator as LeggedEstimator,
    LeggedEstimatorSettings as LeggedEstimatorSettings,
)
from lgmpc.estimation.legs import ContactDetector as ContactDetector, LegSensing as LegSensing
from lgmpc.estimation.plausibility import MeasurementMonitor as MeasurementMonitor
from lgmpc.estimation.prediction import DelaySettings as DelaySettings, StatePredictor as StatePredictor
from lgmpc.estimation.wrench import SteadyForce as SteadyForce, WrenchObserver as WrenchObserver
