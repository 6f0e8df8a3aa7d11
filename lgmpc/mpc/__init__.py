"""Model-predictive control: receding horizons on top of the real-time solvers, behind one contract."""

from lgmpc.mpc.centroidal import CentroidalMpc, CentroidalMpcSettings
from lgmpc.mpc.fallback import FallbackMpc
from lgmpc.mpc.full_body import FullBodyMpc, FullBodyMpcSettings, FullBodyWeights
from lgmpc.mpc.interface import MeasuredState, Mpc
from lgmpc.mpc.kinodynamic import KinodynamicMpc, KinodynamicMpcSettings, KinodynamicWeights
from lgmpc.mpc.lqr import CentroidalLqr, LinearCentroidal, LqrSettings, linearize_centroidal
from lgmpc.mpc.models import AnyMpcSettings, make_mpc
from lgmpc.mpc.multibody import MultibodyMpc, MultibodyMpcSettings
from lgmpc.mpc.plan import MotionSample, MotionSampler, MpcStatus, Plan, PosturePlan, PostureSample
from lgmpc.mpc.settings import CentroidalWeights, MpcSettings, MultibodyWeights, SqpMpcSettings, TrackingWeights
from lgmpc.mpc.sqp import SqpMpc

__all__ = [
    "AnyMpcSettings",
    "CentroidalLqr",
    "CentroidalMpc",
    "CentroidalMpcSettings",
    "CentroidalWeights",
    "FullBodyMpc",
    "FullBodyMpcSettings",
    "FullBodyWeights",
    "KinodynamicMpc",
    "KinodynamicMpcSettings",
    "KinodynamicWeights",
    "LinearCentroidal",
    "LqrSettings",
    "MeasuredState",
    "MotionSample",
    "MotionSampler",
    "Mpc",
    "MpcSettings",
    "MpcStatus",
    "MultibodyMpc",
    "MultibodyMpcSettings",
    "MultibodyWeights",
    "Plan",
    "PosturePlan",
    "PostureSample",
    "SqpMpc",
    "SqpMpcSettings",
    "FallbackMpc",
    "TrackingWeights",
    "linearize_centroidal",
    "make_mpc",
]
