"""Model-predictive control: receding horizons on top of the real-time solvers, behind one contract."""

from lgmpc.mpc.centroidal import CentroidalMpc, CentroidalMpcSettings
from lgmpc.mpc.fallback import FallbackMpc
from lgmpc.mpc.full_body import FullBodyMpc, FullBodyMpcSettings, FullBodyWeights
from lgmpc.mpc.interface import MeasuredState, Mpc
from lgmpc.mpc.models import AnyMpcSettings, make_mpc
from lgmpc.mpc.plan import MotionSample, MotionSampler, MpcStatus, Plan, PosturePlan, PostureSample
from lgmpc.mpc.settings import CentroidalWeights, MpcSettings
from lgmpc.mpc.sqp import SqpMpc

__all__ = [
    "AnyMpcSettings",
    "CentroidalMpc",
    "CentroidalMpcSettings",
    "CentroidalWeights",
    "FullBodyMpc",
    "FullBodyMpcSettings",
    "FullBodyWeights",
    "MeasuredState",
    "MotionSample",
    "MotionSampler",
    "Mpc",
    "MpcSettings",
    "MpcStatus",
    "Plan",
    "PosturePlan",
    "PostureSample",
    "SqpMpc",
    "FallbackMpc",
    "make_mpc",
]
