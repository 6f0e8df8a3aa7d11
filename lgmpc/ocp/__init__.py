"""Optimal control problems: data, compiled horizon functions, linear-quadratic subproblem, NLP transcription."""

from lgmpc.ocp.free_durations import FreeDurations as FreeDurations, FreePhase as FreePhase
from lgmpc.ocp.functions import PathFunctions as PathFunctions, SubproblemFunctions as SubproblemFunctions
from lgmpc.ocp.kkt import KktResidual as KktResidual, kkt_residual as kkt_residual
from lgmpc.ocp.numdiff import check_derivatives as check_derivatives
from lgmpc.ocp.problem import ShootingProblem as ShootingProblem, Trajectory as Trajectory
from lgmpc.ocp.quadratic import OcpQp as OcpQp, OcpQpStructure as OcpQpStructure, StoredBlock as StoredBlock
from lgmpc.ocp.shooting import ShootingFunctions as ShootingFunctions
from lgmpc.ocp.transcription import MultipleShooting as MultipleShooting, transcribe as transcribe
