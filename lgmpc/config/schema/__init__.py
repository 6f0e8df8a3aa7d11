"""The shape of a config file, one module per section. Units are in the keys' names and in their descriptions."""

from lgmpc.config.schema.documents import Config, Document, GroundTruth, SolveConfig

__all__ = [
    "Config",
    "Document",
    "GroundTruth",
    "SolveConfig",
]
