"""Optimal control problems: data, compiled horizon functions, linear-quadratic subproblem, NLP transcription."""

from lgmpc.ocp.free_durations import FreeDurations, FreePhase
from lgmpc.ocp.functions import PathFunctions, SubproblemFunctions
from lgmpc.ocp.kkt import KktResidual, kkt_residual
from lgmpc.ocp.numdiff import DerivativeCheck, DerivativeReport, check_derivatives
from lgmpc.ocp.problem import ShootingProblem, Trajectory
from lgmpc.ocp.quadratic import Block, OcpQp, OcpQpStructure
from lgmpc.ocp.shooting import ShootingFunctions
from lgmpc.ocp.transcription import MultipleShooting, transcribe

__all__ = [
    "Block",
    "DerivativeCheck",
    "DerivativeReport",
    "FreeDurations",
    "FreePhase",
    "KktResidual",
    "MultipleShooting",
    "OcpQp",
    "OcpQpStructure",
    "PathFunctions",
    "ShootingFunctions",
    "ShootingProblem",
    "SubproblemFunctions",
    "Trajectory",
    "check_derivatives",
    "kkt_residual",
    "transcribe",
]
