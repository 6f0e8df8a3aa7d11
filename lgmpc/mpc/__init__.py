"""Model-predictive control: receding horizons on top of the real-time solvers."""

from lgmpc.mpc.centroidal import CentroidalMpc
from lgmpc.mpc.full_body import FullBodyMpc
from lgmpc.mpc.kinodynamic import KinodynamicMpc
from lgmpc.mpc.lqr import CentroidalLqr, LinearCentroidal, linearize_centroidal
from lgmpc.mpc.plan import CentroidalPlan, CentroidalSample, MpcStatus, PosturePlan, PostureSample
from lgmpc.mpc.receding import RecedingHorizon
from lgmpc.mpc.settings import (
    CentroidalMpcSettings,
    CentroidalWeights,
    FullBodyMpcSettings,
    FullBodyWeights,
    KinodynamicMpcSettings,
    KinodynamicWeights,
    LqrSettings,
    MpcSettings,
    WholeBodyMpcSettings,
)
from lgmpc.mpc.whole_body import WholeBodyMpc

__all__ = [
    "CentroidalLqr",
    "CentroidalMpc",
    "CentroidalMpcSettings",
    "CentroidalPlan",
    "CentroidalSample",
    "CentroidalWeights",
    "FullBodyMpc",
    "FullBodyMpcSettings",
    "FullBodyWeights",
    "KinodynamicMpc",
    "KinodynamicMpcSettings",
    "KinodynamicWeights",
    "LinearCentroidal",
    "LqrSettings",
    "MpcSettings",
    "MpcStatus",
    "PosturePlan",
    "PostureSample",
    "RecedingHorizon",
    "WholeBodyMpc",
    "WholeBodyMpcSettings",
    "linearize_centroidal",
]
