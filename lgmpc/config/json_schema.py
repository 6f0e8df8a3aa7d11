"""The JSON schema of configs, from which editors complete and explain keys."""

from __future__ import annotations

import json

from pydantic.json_schema import models_json_schema

from lgmpc.config.schema import Config, SolveConfig

__all__ = ["json_schema_text"]


def json_schema_text() -> str:
    """Return the JSON schema of both kinds of configs, :class:`Config` and :class:`SolveConfig`, as text."""
    _, definitions = models_json_schema([(Config, "validation"), (SolveConfig, "validation")])
    either = [{"$ref": f"#/$defs/{root.__name__}"} for root in (Config, SolveConfig)]
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "anyOf": either, **definitions}
    return json.dumps(schema, indent=2) + "\n"
