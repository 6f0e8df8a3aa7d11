"""The schema of configs: every key is documented, and the file for editors is up to date."""

import json
from pathlib import Path
from typing import Any, get_args

import pytest

from lgmpc.config.schema import Config, SolveConfig, json_schema_text
from lgmpc.mpc import CentroidalMpcSettings, FullBodyMpcSettings
from lgmpc.robot import RobotSpec
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.wbc import WholeBodySettings

SCHEMA_FILE = Path(__file__).resolve().parents[2] / "configs" / "schema.json"


def sections(annotation: Any) -> list[type[Any]]:
    if isinstance(annotation, type):
        return [annotation] if hasattr(annotation, "model_fields") else []
    return [found for inner in get_args(annotation) for found in sections(inner)]


def all_sections(root: type[Any]) -> list[type[Any]]:
    found = [root]
    for field in root.model_fields.values():
        for inner in sections(field.annotation):
            found += all_sections(inner)
    return found


@pytest.mark.parametrize("section", [*all_sections(Config), *all_sections(SolveConfig)], ids=lambda each: each.__name__)
def test_every_key_is_described_and_the_unit_of_its_name_is_explained(section: type[Any]) -> None:
    words = {
        "_hz": ("Hz", "1/s"),
        "_s": (" s", "/s"),
        "_m": (" m",),
        "_deg": ("degrees",),
        "_rad": ("rad",),
        "_n": ("N",),
        "_nm": ("N.m",),
        "_kg": ("kg",),
    }
    for name, field in section.model_fields.items():
        assert field.description, f"{section.__name__}.{name}"
        unit = name[name.rfind("_") :] if "_" in name else ""
        if unit in words:
            said = [word for word in words[unit] if word in field.description]
            assert said, f"{section.__name__}.{name} does not say {' or '.join(words[unit])}"


def keys(schema: Any) -> Any:
    """Return the parts that all versions of pydantic write alike: keys, descriptions and defaults."""
    definitions = schema["$defs"]
    return {
        (name, key): (value.get("description"), value.get("default"))
        for name, definition in definitions.items()
        for key, value in definition.get("anyOf", [definition])[-1][
            "properties"
        ].items()  # a text may stand for a table
    }


def test_the_schema_for_editors_is_up_to_date() -> None:
    written, now = json.loads(SCHEMA_FILE.read_text(encoding="utf-8")), json.loads(json_schema_text())
    assert keys(written) == keys(now), "write it anew: lgmpc schema > configs/schema.json"


def test_shipped_configs_name_the_schema(shipped: Path) -> None:
    assert shipped.read_text(encoding="utf-8").startswith(f"# yaml-language-server: $schema={SCHEMA_FILE.name}\n")


def test_sections_have_defaults_that_can_run() -> None:
    models = (CentroidalMpcSettings, FullBodyMpcSettings)
    for section in (PlantSettings, *models, WholeBodySettings):
        assert section() == section.model_validate({})
    assert RobotSpec(model="solo12").contact_radius_m == 0.0
