"""Configs: their shape, reading and writing them, and the session that one of them describes."""

from lgmpc.config.loading import dump_config, load_config, parse_config
from lgmpc.config.schema import Config

__all__ = ["Config", "dump_config", "load_config", "parse_config"]
