"""From the document of a sweep to its points, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config import load_config
from lgmpc.errors import ConfigError, ConfigErrors
from lgmpc.shipped import shipped_config, shipped_sweeps
from lgmpc.sweeps import load_sweep, parse_sweep
from lgmpc.sweeps.folder import DOCUMENT, SweepFolder

from .conftest import Parse

GRID = """
factors:
  - {key: [plant.friction, wbc.friction], kind: values, values: [0.4, 0.8]}
  - {key: plant.joint_friction_nm, kind: values, values: [0.0, 0.1, 0.2]}
variants:
  soft: {wbc.weights.posture: 0.1}
  stiff: {wbc.weights.posture: 10.0}
"""


def test_a_grid_has_every_combination_with_its_variants_side_by_side(parse: Parse) -> None:
    points = parse(GRID).points
    assert len(points) == 12
    found = [(p.config.plant.friction, p.config.plant.joint_friction_nm, p.variant) for p in points]
    assert found == [(mu, tau, name) for mu in (0.4, 0.8) for tau in (0.0, 0.1, 0.2) for name in ("soft", "stiff")]
    assert all(p.config.wbc.friction == p.config.plant.friction for p in points)
    assert all(p.config.wbc.weights.posture == {"soft": 0.1, "stiff": 10.0}[p.variant] for p in points)
    assert all(p.config.duration_s == 0.1 and not p.config.mpc.enabled for p in points)
    assert len({p.key for p in points}) == 12


def test_a_draw_reaches_into_the_section_that_a_variant_sets(parse: Parse) -> None:
    samples = "samples: {count: 3, keys: [{key: world.ahead_m, kind: uniform, range: [0.9, 1.1]}]}"
    points = parse("variants: {a: {world: {kind: ramp_15deg}}, b: {world: {kind: drop_3cm}}}\n" + samples).points
    assert [p.config.value("world.ahead_m") for p in points] == [p.levels["world.ahead_m"] for p in points]
    assert len({p.key for p in points}) == 6


def test_the_document_in_the_folder_of_a_sweep_refers_to_the_same_bases(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(shipped_config("solo12_stand").copy_text(), encoding="utf-8")
    file = tmp_path / "sweep.yaml"
    file.write_text("name: a\nbase: [own.yaml, solo12_stand]\n" + GRID, encoding="utf-8")
    sweep = load_sweep(file)
    assert sweep.settings.base == (str(tmp_path / "own.yaml"), "solo12_stand")
    folder = SweepFolder.open(tmp_path / "elsewhere" / "a", sweep, resume=False)
    folder.close()
    assert load_sweep(folder.path / DOCUMENT) == sweep


def test_the_rest_of_a_point_is_its_base(parse: Parse) -> None:
    point = parse(GRID).points[0]
    back = {"duration_s": 6.0, "mpc.enabled": True, "plant": load_config("solo12_stand").plant}
    assert point.config.robot == load_config("solo12_stand").robot
    assert point.config.replace(back).plant == load_config("solo12_stand").plant


def test_keys_identify_what_is_computed(parse: Parse) -> None:
    assert [p.key for p in parse(GRID).points] == [p.key for p in parse(GRID, "logs.keep=3").points]
    changed = parse(GRID, "set.seed=1").points
    assert not {p.key for p in parse(GRID).points} & {p.key for p in changed}


def test_directions_are_unit_vectors_around_the_circle() -> None:
    text = """
factors: [{key: pushes.0.impulse_ns, kind: directions, count: 8}]
set: {duration_s: 0.1, pushes: [{body: base_link, time_s: 0.0, impulse_ns: [0, 0, 0]}]}
"""
    points = parse_sweep("name: a\nbase: solo12_stand\n" + text).points
    for i, point in enumerate(points):
        x, y, z = point.config.pushes[0].impulse_ns
        assert (x, y, z) == pytest.approx((math.cos(math.pi * i / 4), math.sin(math.pi * i / 4), 0.0), abs=1e-9)


SAMPLES = """
samples:
  count: 40
  seed: 5
  method: latin_hypercube
  keys:
    - {key: plant.friction, kind: uniform, range: [0.4, 0.8]}
    - {key: plant.joint_damping_nms, kind: log_uniform, range: [1.0e-3, 1.0]}
    - {key: plant.mass_scale, kind: normal, mean: 1.0, std: 0.01}
    - {key: plant.kind, kind: choice, values: [mujoco, pinocchio]}
    - {key: plant.base_com_offset_m, kind: horizontal, range: [0.01, 0.02]}
"""


def test_draws_follow_their_distributions(parse: Parse) -> None:
    points = parse(SAMPLES).points
    plants = [p.config.plant for p in points]
    friction = np.sort([p.friction for p in plants])
    assert np.all(np.floor((friction - 0.4) / 0.4 * 40) == np.arange(40))  # one in each of 40 parts
    damping = np.sort(np.log10([p.joint_damping_nms for p in plants]))
    assert np.all(np.floor((damping + 3.0) / 3.0 * 40) == np.arange(40))
    # One in each 40th of the normal distribution: mean and deviation are within those of the middle and end parts.
    assert np.mean([p.mass_scale for p in plants]) == pytest.approx(1.0, abs=1e-3)
    assert np.std([p.mass_scale for p in plants]) == pytest.approx(0.01, rel=0.1)
    assert sum(p.kind == "mujoco" for p in plants) == 20
    sizes = [math.hypot(*p.base_com_offset_m) for p in plants]
    assert 0.01 <= min(sizes) < 0.0105
    assert 0.0195 < max(sizes) <= 0.02
    assert [p.config.seed for p in points] == list(range(5, 45))


def test_the_seed_decides_the_draws(parse: Parse) -> None:
    few = SAMPLES.replace("40", "3")
    assert [p.key for p in parse(few).points] == [p.key for p in parse(few).points]
    assert parse(few).points[0].levels != parse(few, "samples.seed=6").points[0].levels


def test_random_draws_are_not_stratified(parse: Parse) -> None:
    friction = np.sort([p.config.plant.friction for p in parse(SAMPLES, "samples.method=random").points])
    assert np.any(np.floor((friction - 0.4) / 0.4 * 40) != np.arange(40))


def test_shipped_sweeps_load_and_their_bases_are_runnable() -> None:
    assert "push_map" in shipped_sweeps()
    for name, shipped in shipped_sweeps().items():
        sweep = load_sweep(name)
        assert sweep.settings.name == name
        assert len(sweep.points) > 1
        assert f"#   lgmpc sweep configs/sweeps/{name}.yaml\n" in shipped.text
        assert 40 < len(shipped.summary) < 125


def test_a_point_does_not_change_what_the_next_one_starts_from(parse: Parse) -> None:
    points = parse("variants: {a: {gate.max_slip_m: 0.1}, b: {}}").points
    assert [p.config.gate.max_slip_m for p in points] == [0.1, None]
    assert {p.config.gate.max_tilt_deg for p in points} == {5.0}


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("factors: [{key: plant.frction, kind: values, values: [1]}]", "factors.0", "Did you mean plant.friction"),
        ("factors: [{key: plant.friction, kind: values, values: [-1]}]", "factors.0", "plant.friction: -1; expected"),
        ("factors: [{key: plant.friction, kind: values, values: []}]", "factors.0.values", "at least 1"),
        ("factors: [{key: plant.friction, kind: value, values: [1]}]", "factors.0.kind", "Did you mean values"),
        ("factors: []", "factors", "expected a variation"),
        ("variants: {a: {mpc.enabld: true}}", "variants.a.mpc.enabld", "Did you mean mpc.enabled"),
        ("bisect: {key: plant.fric, range: [0.1, 1.0], tolerance: 0.1}", "bisect", "Did you mean plant.friction"),
        ("bisect: {key: plant.friction, range: [1.0, 1.0], tolerance: 0.1}", "bisect.range", "lowest below highest"),
        ("bisect: {key: plant.friction, range: [0.5, 1.0], tolerance: 0.5}", "bisect.tolerance", "less than the width"),
        ("variants: {a: {}, b: {}}\nmetrics: [max_tlt_deg]", "metrics.0", "Did you mean max_tilt_deg"),
        ("samples: {count: 0, keys: []}", "samples.count", "not below 1"),
        (
            "factors: [{key: seed, kind: values, values: [1]}]\nvariants: {a: {seed: 2}}",
            "variants.a.seed",
            "no factor varies",
        ),
    ],
)
def test_what_cannot_be_swept_is_refused_with_its_place(parse: Parse, text: str, place: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(text)
    first = caught.value.problems[0] if isinstance(caught.value, ConfigErrors) else caught.value
    assert first.key == place
    assert words in str(caught.value)


def test_an_unknown_base_or_sweep_gets_the_nearest(parse: Parse) -> None:
    with pytest.raises(ConfigError, match="Did you mean solo12_stand"):
        parse("", "base=solo12_stnd", "variants={a: {}}")
    with pytest.raises(ConfigError, match=r"base: got panda_reach|lgmpc solve"):
        parse("", "base=panda_reach", "variants={a: {}}")
    with pytest.raises(ConfigError, match="Did you mean push_map"):
        load_sweep("push_mp")


def test_lengths_of_horizontal_vectors_are_not_negative(parse: Parse) -> None:
    draw = "samples: {count: 1, keys: [{key: plant.base_com_offset_m, kind: horizontal, range: [-0.01, 0.02]}]}"
    with pytest.raises(ConfigError, match=r"samples\.keys\.0\.range\.0: got -0\.01; expected a number not below 0"):
        parse(draw)
