"""Configs: their schema, reading and writing them, and the sessions built from them."""

from lgmpc.config.loading import (
    dump_config as dump_config,
    load_any_config as load_any_config,
    load_config as load_config,
    load_solve_config as load_solve_config,
    parse_any_config as parse_any_config,
    parse_config as parse_config,
    parse_solve_config as parse_solve_config,
)
from lgmpc.config.schema import Config as Config, Document as Document, SolveConfig as SolveConfig
