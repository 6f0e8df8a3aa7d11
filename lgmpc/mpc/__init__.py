"""Model-predictive control: receding horizons on top of the real-time solvers, behind one contract."""

from lgmpc.mpc.centroidal import CentroidalMpc as CentroidalMpc, CentroidalMpcSettings as CentroidalMpcSettings
from lgmpc.mpc.fallback import FallbackMpc as FallbackMpc
from lgmpc.mpc.full_body import (
    FullBodyMpc as FullBodyMpc,
    FullBodyMpcSettings as FullBodyMpcSettings,
    FullBodyWeights as FullBodyWeights,
)
from lgmpc.mpc.interface import MeasuredState as MeasuredState, Mpc as Mpc
from lgmpc.mpc.models import AnyMpcSettings as AnyMpcSettings, make_mpc as make_mpc
from lgmpc.mpc.plan import (
    MotionSampler as MotionSampler,
    Plan as Plan,
    PosturePlan as PosturePlan,
    PostureSample as PostureSample,
)
from lgmpc.mpc.settings import CentroidalWeights as CentroidalWeights, MpcSettings as MpcSettings
