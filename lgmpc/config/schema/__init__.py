"""The shape of a config file, one module per section. Units are in the keys' names and in their descriptions."""

from lgmpc.config.schema.documents import Config, Document, GroundTruth, SolveConfig
from lgmpc.config.schema.solver import SolverSection

__all__ = [
    "Config",
    "Document",
    "GroundTruth",
    "SolveConfig",
    "SolverSection",
]
