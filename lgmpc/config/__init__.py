"""Configs: their schema, reading and writing them, and the sessions built from them."""

from lgmpc.config.loading import (
    dump_config,
    load_any_config,
    load_config,
    load_solve_config,
    parse_any_config,
    parse_config,
    parse_solve_config,
)
from lgmpc.config.schema import Config, Document, SolveConfig

__all__ = [
    "Config",
    "Document",
    "SolveConfig",
    "dump_config",
    "load_any_config",
    "load_config",
    "load_solve_config",
    "parse_any_config",
    "parse_config",
    "parse_solve_config",
]
