from __future__ import annotations

import math

import pytest

from lgmpc.errors import InputError
from lgmpc.mpc import CentroidalMpcSettings, CentroidalWeights, FullBodyWeights, KinodynamicWeights


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nodes": 1}, "nodes: got 1; expected a whole number of at least 2"),
        ({"nodes": 2.5}, "nodes: got 2.5"),
        ({"nodes": True}, "nodes: got True"),
        ({"facets": 2}, "facets: got 2; expected a whole number of at least 3"),
        ({"sqp_iterations": 0}, "sqp_iterations: got 0"),
        ({"stale_after": -1}, "stale_after: got -1"),
        ({"node_duration": 0.0}, "node_duration: got 0.0; expected a positive number"),
        ({"friction": -0.5}, "friction: got -0.5"),
        ({"friction": "slippery"}, "friction: got slippery"),
        ({"normal_force_max": math.inf}, "normal_force_max: got inf"),
        ({"normal_force_min": 30.0}, "normal_force_min: got 30.0; expected a number from 0 to below"),
        ({"qp_solver": "oqsp"}, "qp_solver: got oqsp; .* Did you mean osqp"),
    ],
)
def test_settings_refuse_what_cannot_be_used(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        CentroidalMpcSettings(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"com": -1.0}, "weights.com: got -1.0; expected a finite non-negative number"),
        ({"com": (1.0, 2.0)}, "weights.com"),
        ({"linear_momentum": math.nan}, "weights.linear_momentum: got nan"),
        ({"force": 0.0}, "weights.force: got 0.0; expected positive numbers"),
        ({"force": (1.0, 0.0, 1.0)}, "weights.force"),
        ({"terminal": "ten"}, "weights.terminal: got ten"),
    ],
)
def test_weights_refuse_what_makes_no_sense(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        CentroidalWeights(**change)


def test_every_model_s_controls_need_a_weight() -> None:
    with pytest.raises(InputError, match="weights.effort: got 0.0; expected positive numbers"):
        FullBodyWeights(effort=0.0)
    with pytest.raises(InputError, match="weights.joint_velocity: got 0; expected positive numbers"):
        KinodynamicWeights(joint_velocity=0)
    assert FullBodyWeights(force=0.0, joint_velocity=0.0).state() == FullBodyWeights().state()
    with pytest.raises(InputError, match="weights.posture: got -1; expected a finite non-negative"):
        FullBodyWeights(posture=-1)


def test_weights_are_for_all_axes_or_one_each() -> None:
    weights = CentroidalWeights(com=(1.0, 2.0, 3.0), linear_momentum=4.0, angular_momentum=5.0, force=(0.1, 0.1, 0.2))
    assert weights.state() == [1.0, 2.0, 3.0, 4.0, 4.0, 4.0, 5.0, 5.0, 5.0]
    assert weights.forces(2) == [0.1, 0.1, 0.2, 0.1, 0.1, 0.2]
