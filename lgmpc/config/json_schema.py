"""The JSON schema of configs, from which editors complete and explain keys."""

from __future__ import annotations

import json

from lgmpc.config.schema import Config

__all__ = ["json_schema_text"]


def json_schema_text() -> str:
    """Return the JSON schema of :class:`Config` as text."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Config.model_json_schema()}
    return json.dumps(schema, indent=2) + "\n"
