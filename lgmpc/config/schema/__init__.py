"""The shape of a config file, one module per section. Units are in the keys' names and in their descriptions."""

from lgmpc.config.schema.document import Document
from lgmpc.config.schema.estimator import EstimatorSection, GroundTruth, InvariantEkfSection
from lgmpc.config.schema.log import LogSection
from lgmpc.config.schema.plant import PlantSection
from lgmpc.config.schema.problem import ProblemSection
from lgmpc.config.schema.pushes import PushSection
from lgmpc.config.schema.reference import ComCircleReference, ReferenceSection, StandReference
from lgmpc.config.schema.robot import RobotSection
from lgmpc.config.schema.root import Config
from lgmpc.config.schema.sensors import SensorsSection
from lgmpc.config.schema.solve import SolveConfig
from lgmpc.config.schema.solve_gate import SolveGateSection
from lgmpc.config.schema.solver import SolverSection
from lgmpc.config.schema.wbc import WbcGain, WbcGains, WbcSection, WbcWeights

__all__ = [
    "ComCircleReference",
    "Config",
    "Document",
    "EstimatorSection",
    "GroundTruth",
    "InvariantEkfSection",
    "LogSection",
    "PlantSection",
    "ProblemSection",
    "PushSection",
    "ReferenceSection",
    "RobotSection",
    "SensorsSection",
    "SolveConfig",
    "SolveGateSection",
    "SolverSection",
    "StandReference",
    "WbcGain",
    "WbcGains",
    "WbcSection",
    "WbcWeights",
]
