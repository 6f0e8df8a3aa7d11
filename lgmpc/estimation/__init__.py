"""Estimation of the floating base's motion, of contacts, external wrenches and friction."""

from lgmpc.estimation.friction import FrictionMonitor
from lgmpc.estimation.inertial import ImuNoise, exponential_increment
from lgmpc.estimation.invariant_ekf import InvariantEkf
from lgmpc.estimation.joint_faults import JointFaultMonitor, JointFaultSettings
from lgmpc.estimation.joint_friction import JointFrictionEstimator, JointFrictionSettings
from lgmpc.estimation.legged import LeggedEstimator, LeggedEstimatorSettings
from lgmpc.estimation.legs import ContactDetector, LegSensing
from lgmpc.estimation.plausibility import MeasurementMonitor
from lgmpc.estimation.prediction import DelaySettings, StatePredictor
from lgmpc.estimation.wrench import SteadyForce, WrenchObserver

__all__ = [
    "ContactDetector",
    "DelaySettings",
    "FrictionMonitor",
    "ImuNoise",
    "InvariantEkf",
    "JointFaultMonitor",
    "JointFaultSettings",
    "JointFrictionEstimator",
    "JointFrictionSettings",
    "LegSensing",
    "LeggedEstimator",
    "LeggedEstimatorSettings",
    "MeasurementMonitor",
    "StatePredictor",
    "SteadyForce",
    "WrenchObserver",
    "exponential_increment",
]
