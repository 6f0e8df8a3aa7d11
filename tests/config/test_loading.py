"""Configs: accepted and refused values, messages, and writing and reading back."""

import math
import os
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st
from pydantic import ValidationError

from lgmpc.config import Config, dump_config, load_any_config, load_config, parse_any_config, parse_config
from lgmpc.errors import ConfigError, ConfigErrors

ROOT = Path(__file__).resolve().parents[2]


def message(text: str, *overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, name="f.yaml", overrides=overrides)
    return str(caught.value)


def test_shipped_configs_are_valid_and_read_back_equal(shipped: Path) -> None:
    config = load_any_config(shipped)
    assert config.name == shipped.stem
    assert parse_any_config(dump_config(config)) == config


def test_a_config_cannot_be_changed(small: str) -> None:
    with pytest.raises(ValidationError, match="frozen"):
        parse_config(small).plant.friction = 2.0  # type: ignore[misc]


def test_overrides_change_the_file(small_file: Path) -> None:
    config = load_config(
        small_file, ["mpc.enabled=false", "pushes.0.impulse_ns=[0, 3, 0]", "robot.posture={'*_HAA': 0.1}"]
    )
    assert not config.mpc.enabled
    assert config.pushes[0].impulse_ns == (0.0, 3.0, 0.0)
    assert config.robot.posture == {"*_HAA": 0.1}


BAD_VALUES = [
    # key=value, where it is found, what the message says
    ("plant.friction=0", "plant.friction: got 0; expected a number greater than 0"),
    ("plant.mass_scale=-1", "plant.mass_scale: got -1; expected a number not below 0.01"),
    ("plant.friction=.nan", "plant.friction: got NaN (.nan); expected a finite number"),
    ("plant.friction=.inf", "plant.friction: got inf; expected a finite number"),
    ("plant.friction='0.6'", "plant.friction: got the text '0.6'; expected a number"),
    ("plant.friction=true", "plant.friction: got true; expected a number"),
    ("plant.friction=", "plant.friction: got nothing (null); expected a number"),
    ("plant.kind=mojoco", "plant.kind: got the text 'mojoco'; expected one of mujoco, pinocchio"),
    ("plant=[1]", "plant: got the list [1]; expected a table of keys"),
    (
        "plant.base_com_offset_m=[0, 1]",
        "plant.base_com_offset_m: got the list [0, 1]; expected a list of three numbers",
    ),
    ("mpc.model=fullbody", "mpc.model: got the text 'fullbody'; expected one of centroidal, full_body"),
    ("mpc.model=", "mpc.model: got nothing (null); expected one of centroidal, full_body"),
    (
        "mpc={model: full_body, weights: {effort: 0}}",
        "mpc.weights.effort: got 0; expected a number greater than 0 (Joint torques",
    ),
    ("mpc.enabled=yes", "mpc.enabled: got the text 'yes'; expected true or false"),
    ("mpc.enabled=1", "mpc.enabled: got 1; expected true or false"),
    ("mpc.nodes=2.5", "mpc.nodes: got 2.5; expected a whole number"),
    ("mpc.nodes=0", "mpc.nodes: got 0; expected a number not below 2"),
    ("mpc.weights.force=-1", "mpc.weights.force: got -1; expected a number greater than 0"),
    ("mpc.normal_force_n=[5, 1]", "mpc.normal_force_n: got the list [5, 1]; expected [lowest, highest]"),
    ("wbc.friction_facets=2", "wbc.friction_facets: got 2; expected a number not below 3"),
    ("robot.effort_limit_nm=0", "robot.effort_limit_nm: got 0; expected a number not below 1e-06"),
    ("robot.effort_limit_nm={'*_HAA': x}", "robot.effort_limit_nm.*_HAA: got the text 'x'; expected a number"),
    (
        "robot.position_limit_rad={a: [1, 0]}",
        "robot.position_limit_rad.a: got the list [1, 0]; expected [lowest, highest]",
    ),
    ("robot.contact_frames=FL_FOOT", "robot.contact_frames: got the text 'FL_FOOT'; expected a list"),
    ("robot.contact_frames=[A, A]", "robot.contact_frames.1: got the text 'A'; expected each frame once"),
    ("robot.posture=3", "robot.posture: got 3; expected text"),
    ("robot.urdf=a.urdf", "expected no file here, because model is given (solo12)"),
    ("robot.urdf=~nosuchuser/a.urdf", "robot.urdf: got the text '~nosuchuser/a.urdf'; expected a path"),
    ('robot.package_dirs=["a\\0b"]', "robot.package_dirs.0: got the text"),
    ("robot.model=null", "robot.model: got nothing (null); expected a robot's name here, or a file in the key urdf"),
    ("reference={kind: com_circle, radius_m: .nan}", "reference.radius_m: got NaN (.nan); expected a finite number"),
    ("reference.kind=com_circl", "reference.kind: got the text 'com_circl'; expected one of stand, com_circle"),
    ("reference.radius_m=1", "reference.kind: got nothing (null); expected one of stand, com_circle"),
    ("pushes.0.impulse_ns=[0, .nan, 0]", "pushes.0.impulse_ns.1: got NaN (.nan); expected a finite number"),
    ("pushes.1.body=x", "pushes.1.time_s: got nothing; expected a value (Start of the push, s)"),
    ("pushes=[3]", "pushes.0: got 3; expected a table of keys"),
    ("name='a b'", "name: got the text 'a b'; expected letters, digits"),
    ("name=..", "name: got the text '..'; expected letters, digits"),
    ("seed=-1", "seed: got -1; expected a number not below 0"),
    ("wbc.rate_hz=300", "wbc.rate_hz: got 300; expected plant.rate_hz (1000) divided by a whole number"),
    ("log.rate_hz=2000", "log.rate_hz: got 2000; expected wbc.rate_hz (1000) divided by a whole number"),
    ("gate.max_solver_failures=-1", "gate.max_solver_failures: got -1; expected a number not below 0"),
]


@pytest.mark.parametrize(("override", "expected"), BAD_VALUES, ids=[each[0] for each in BAD_VALUES])
def test_errors_name_place_value_and_expectation(small: str, override: str, expected: str) -> None:
    text = message(small, override)
    assert expected in text
    assert "--set: " in text


@pytest.mark.parametrize(
    ("value", "got"), [("0", "0"), ("[]", "the list []"), ("abc", "the text 'abc'"), ("null", "nothing (null)")]
)
def test_what_is_no_table_of_joints_is_refused(value: str, got: str) -> None:
    key = "problem.strokes.stretched_rad"
    with pytest.raises(ConfigError) as caught:
        load_any_config(ROOT / "configs" / "solo12_righting.yaml", [f"{key}={value}"])
    assert str(caught.value).startswith(f"--set: {key}: got {got}; expected a table {{key: value}} (")


UNKNOWN_KEYS = [
    ("mpc.rate_hzz=1", "mpc.rate_hzz: got an unknown key (value 1); expected a key of mpc. Did you mean mpc.rate_hz"),
    ("plant.frction=1", "Did you mean plant.friction"),
    ("plant.Friction=1", "Did you mean plant.friction"),
    ("duration=5", "Did you mean duration_s?"),
    ("robot.effort_limit=2", "Did you mean robot.effort_limit_nm"),
    ("wbc.enabled=true", "Did you mean mpc.enabled?"),
    ("friction=1", "wbc.friction"),
    ("pushes.0.bodi=x", "Did you mean pushes.0.body?"),
    ("mpc={model: full_body, weights: {efort: 1}}", "Did you mean mpc.weights.effort"),
    ("reference={kind: com_circle, radius: 1}", "Did you mean reference.radius_m"),
    ("log.zzz=1", "Did you mean log.rate_hz?"),
]


KEYS_OF_OTHERS = [
    (
        "mpc.weights.effort=1",
        "mpc.weights.effort: got a key that only mpc.model = full_body has (value 1); "
        "expected a key of mpc.weights for mpc.model = centroidal",
    ),
    (
        "mpc.weights={posture: 1}",
        "mpc.weights.posture: got a key that only mpc.model = full_body has (value 1); "
        "expected a key of mpc.weights for mpc.model = centroidal",
    ),
    (
        "mpc={model: full_body, uprighting_rate_hz: 1}",
        "mpc.uprighting_rate_hz: got a key that only mpc.model = centroidal has (value 1); "
        "expected a key of mpc for mpc.model = full_body",
    ),
    (
        "reference={kind: stand, radius_m: 1}",
        "reference.radius_m: got a key that only reference.kind = com_circle has (value 1)",
    ),
]


@pytest.mark.parametrize(("override", "expected"), KEYS_OF_OTHERS, ids=[each[0] for each in KEYS_OF_OTHERS])
def test_keys_of_another_variant_name_it(small: str, override: str, expected: str) -> None:
    assert expected in message(small, override)


@pytest.mark.parametrize(("override", "expected"), UNKNOWN_KEYS, ids=[each[0] for each in UNKNOWN_KEYS])
def test_unknown_keys_name_the_nearest_valid_one(small: str, override: str, expected: str) -> None:
    text = message(small, override)
    assert "got an unknown key" in text
    assert expected in text


def test_problems_in_the_file_have_its_line(small: str) -> None:
    assert message(small + "plant:\n  frction: 0.6\n").startswith("f.yaml:9: plant.frction: got an unknown key")
    assert message(small.replace("[0, 2, 0]", "[0, 2]")).startswith("f.yaml:7: pushes.0.impulse_ns:")
    assert message("name: a\n").startswith("f.yaml: robot: got nothing; expected a value")
    assert message("name: a\nrobot: {}\n").startswith("f.yaml:2: robot.model:")


def test_all_problems_are_listed_at_once(small: str) -> None:
    with pytest.raises(ConfigErrors) as caught:
        parse_config(small + "plant:\n  friction: 0\n  kindd: x\n", name="f.yaml", overrides=["seed=x", "mpc.nodes=0"])
    assert {problem.key for problem in caught.value.problems} == {"plant.friction", "plant.kindd", "seed", "mpc.nodes"}
    assert str(caught.value).startswith("4 problems in the config:\n  - ")
    assert all(str(problem) in str(caught.value) for problem in caught.value.problems)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "f.yaml: got an empty file"),
        ("# only a comment\n", "f.yaml: got an empty file"),
        ("[1, 2]", "f.yaml: got the list [1, 2]; expected a table of keys"),
        ("solo12", "f.yaml: got the text 'solo12'; expected a table of keys"),
    ],
)
def test_what_is_no_table_is_refused(text: str, expected: str) -> None:
    assert message(text).startswith(expected)


def test_a_missing_file_names_its_neighbour(small_file: Path) -> None:
    with pytest.raises(ConfigError, match=r"smal\.yaml: got no such file; .* Did you mean .*small\.yaml\?"):
        load_config(small_file.with_name("smal.yaml"))


def test_a_folder_is_not_a_config(small_file: Path) -> None:
    with pytest.raises(ConfigError, match="got a folder; expected a YAML file"):
        load_config(small_file.parent)


def test_a_binary_file_is_not_a_config(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(b"\x80\x81")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_config(path)


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="needs a file that cannot be read even by root")
def test_a_file_that_cannot_be_read_says_why() -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config("/proc/self/mem")


def test_paths_start_from_where_they_were_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    path = tmp_path / "own.yaml"
    path.write_text("name: own\nrobot: {urdf: own.urdf, package_dirs: [., ~/models]}\n", encoding="utf-8")
    config = load_config(path, ["robot.srdf=own.srdf"])
    assert config.robot.urdf == tmp_path / "own.urdf"
    assert config.robot.package_dirs == (tmp_path, Path(os.path.expanduser("~/models")).resolve())
    assert config.robot.srdf == elsewhere / "own.srdf"


def test_a_config_stores_the_sources_of_its_values(small: str) -> None:
    config = parse_config(small, name="f.yaml", overrides=["pushes.0.body=base"])
    assert str(config.error("robot.model", "solo12", "x")).startswith("f.yaml:3: robot.model: got solo12")
    assert str(config.error("robot.posture", "y", "x")).startswith("f.yaml:2: robot.posture:")
    assert str(config.error("pushes.0.body", "y", "x")).startswith("--set: pushes.0.body:")
    assert str(config.error("seed", 1, "x")).startswith("f.yaml: seed:")


finite = st.floats(1e-6, 1e6)


@settings(max_examples=40)  # whole configs; 100 texts of any data are read back in test_yaml_text.py
@given(
    friction=st.floats(1e-6, 10.0),
    impulse=st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    name=st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,20}", fullmatch=True),
    limit=st.none() | finite,
)
def test_any_valid_config_reads_back_equal(
    friction: float, impulse: list[float], name: str, limit: float | None
) -> None:
    config = Config.model_validate(
        {
            "name": name,
            "robot": {"model": name},
            "plant": {"friction": friction},
            "pushes": [{"body": name, "time_s": friction, "impulse_ns": impulse}],
            "gate": {"max_tilt_deg": limit},
        }
    )
    again = parse_config(dump_config(config))
    assert again == config
    assert math.copysign(1.0, again.pushes[0].impulse_ns[0]) == math.copysign(1.0, impulse[0])
