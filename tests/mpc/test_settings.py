from __future__ import annotations

import math

import pytest
from pydantic import TypeAdapter

from lgmpc.errors import InputError
from lgmpc.mpc import (
    AnyMpcSettings,
    CentroidalMpc,
    CentroidalMpcSettings,
    CentroidalWeights,
    FullBodyMpcSettings,
    FullBodyWeights,
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nodes": 1}, "nodes: got 1; expected a number not below 2"),
        ({"nodes": 2.5}, "nodes: got 2.5; expected a whole number"),
        ({"nodes": True}, "nodes: got true"),
        ({"friction_facets": 2}, "friction_facets: got 2; expected a number not below 3"),
        ({"sqp_iterations": 0}, "sqp_iterations: got 0"),
        ({"stale_after": -1}, "stale_after: got -1"),
        ({"node_s": 0.0}, "node_s: got 0; expected a number"),
        ({"node_s": 1e-9}, "node_s: got 1e-09; expected a number not below 0.001"),
        ({"friction": -0.5}, "friction: got -0.5"),
        ({"friction": "slippery"}, "friction: got the text 'slippery'"),
        ({"normal_force_n": (0.0, math.inf)}, "normal_force_n"),
        ({"normal_force_n": (30.0, 30.0)}, "normal_force_n: .* lowest below highest"),
        ({"qp_solver": "oqsp"}, "qp_solver: got the text 'oqsp'; .* Did you mean osqp"),
        ({"node_duration": 0.02}, "Did you mean node_s"),
    ],
)
def test_settings_refuse_what_cannot_be_used(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        CentroidalMpcSettings(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"com": (-1.0, 1.0)}, "com: .* three numbers"),
        ({"linear_momentum": math.nan}, "linear_momentum: got NaN"),
        ({"force": 0.0}, "force: got 0; expected a number greater than 0"),
        ({"terminal": "ten"}, "terminal: got the text 'ten'"),
    ],
)
def test_weights_refuse_what_makes_no_sense(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        CentroidalWeights(**change)


def test_every_model_s_controls_need_a_weight() -> None:
    with pytest.raises(InputError, match="effort: got 0"):
        FullBodyWeights(effort=0.0)
    assert FullBodyWeights(joint_velocity=0.0).state(2.5) == FullBodyWeights().state(2.5)


def test_weights_of_momenta_and_forces_scale_with_the_mass() -> None:
    weights = CentroidalWeights(com=(1.0, 2.0, 3.0), linear_momentum=4.0, angular_momentum=5.0, force=0.1)
    assert weights.state(2.5) == [1.0, 2.0, 3.0, 4.0, 4.0, 4.0, 5.0, 5.0, 5.0]
    assert weights.forces(2, 2.5) == [0.1] * 6
    assert weights.state(25.0) == pytest.approx([1.0, 2.0, 3.0, 0.04, 0.04, 0.04, 0.05, 0.05, 0.05])
    assert weights.forces(1, 25.0) == pytest.approx([0.001] * 3)


def test_a_controller_made_in_python_is_the_one_of_a_config() -> None:
    """One set of defaults: what a config leaves out is what the class has."""
    settings = TypeAdapter(AnyMpcSettings).validate_python({})
    assert settings == CentroidalMpcSettings() == CentroidalMpc(2.5, 4).settings


@pytest.mark.parametrize(("model", "kind"), [("centroidal", CentroidalMpcSettings), ("full_body", FullBodyMpcSettings)])
def test_the_model_selects_the_settings(model: str, kind: type) -> None:
    assert type(TypeAdapter(AnyMpcSettings).validate_python({"model": model})) is kind


def test_normal_forces_are_as_given_or_in_proportion_to_the_mass() -> None:
    assert CentroidalMpcSettings().normal_force(2.5) == pytest.approx((0.5, 60.0))
    assert CentroidalMpcSettings(normal_force_n=(1.0, 20.0)).normal_force(50.0) == (1.0, 20.0)
