"""Model-predictive control: receding horizons on top of the real-time solvers."""

from lgmpc.mpc.centroidal import CentroidalMpc
from lgmpc.mpc.plan import CentroidalPlan, CentroidalSample, MpcStatus
from lgmpc.mpc.settings import CentroidalMpcSettings, CentroidalWeights

__all__ = [
    "CentroidalMpc",
    "CentroidalMpcSettings",
    "CentroidalPlan",
    "CentroidalSample",
    "CentroidalWeights",
    "MpcStatus",
]
