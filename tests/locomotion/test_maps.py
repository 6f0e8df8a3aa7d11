"""Maps of the ground and footholds on them, against closed forms and brute force."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from lgmpc.config import load_config
from lgmpc.config.build import build_controller, build_robot
from lgmpc.errors import InputError
from lgmpc.locomotion import FootholdPlanner, LegGeometry, TerrainBeliefSettings
from lgmpc.locomotion.footholds import BaseMotion
from lgmpc.locomotion.maps import KnownMap, KnownMapSettings, SeenMap, SeenMapSettings, even
from lgmpc.locomotion.stepping import MappedBelief
from lgmpc.robot.soles import FootPoints
from lgmpc.typing import Array, BoolArray
from lgmpc.world import World

POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 2))
POSE = np.array([0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 1.0])


def plane(points: Array) -> Array:
    return 0.1 + points @ [0.3, -0.2]


def step(points: Array) -> Array:
    """A step of 5 cm at x = 0.1."""
    return np.where(points[:, 0] > 0.1, 0.05, 0.0)


def known(truth: object, **settings: object) -> KnownMap:
    found = KnownMap(truth, KnownMapSettings(**settings), 0.24, np.random.default_rng(0))  # type: ignore[arg-type]
    found.update(0.0, POSE)
    return found


class Analytic:
    """A user's map: stones in a turned and shifted frame."""

    def __init__(self, yaw: float = 0.0, at: tuple[float, float] = (0.0, 0.0)) -> None:
        c, s = math.cos(yaw), math.sin(yaw)
        self._turn, self._at = np.array([[c, s], [-s, c]]), at

    def update(self, time: float, pose: Array) -> None: ...

    def height(self, points: Array) -> Array:
        local = (points - self._at) @ self._turn.T
        return np.where((np.abs((local % 0.2) - 0.1) < 0.06).all(axis=1), 0.0, -0.3)

    def steppable(self, points: Array, radius: float) -> BoolArray:
        return even(self.height, points, radius, 0.01)


def believed(legs: LegGeometry, elevation: object, pose: Array = POSE) -> MappedBelief:
    belief = MappedBelief(FootPoints((1,) * 4, np.zeros((4, 3))), legs, TerrainBeliefSettings(), elevation, pose)  # type: ignore[arg-type]
    belief.begin(np.column_stack([pose[:2] + legs.feet[:, :2], np.zeros(4)]))
    return belief


def test_planes_are_even_and_steps_are_not() -> None:
    assert even(plane, POINTS, 0.03, 1e-9).all()
    np.testing.assert_array_equal(even(step, POINTS, 0.03, 1e-3), np.abs(POINTS[:, 0] - 0.1) > 0.03)
    assert not even(lambda points: 1.1 * points[:, 0], POINTS, 0.03, 1e-3).any()  # 48 degrees


def test_a_grid_has_the_heights_of_a_plane_and_knows_edges_to_a_cell() -> None:
    grid = known(plane)
    np.testing.assert_allclose(grid.height(POINTS), plane(POINTS), atol=1e-12)
    assert grid.steppable(POINTS, 0.026).all()
    grid = known(step)
    away = np.abs(POINTS[:, 0] - 0.1)
    found = grid.steppable(POINTS, 0.026)
    assert found[away > 0.026 + 2.0 * grid.cell].all() and not found[away < 0.026 - grid.cell].any()
    assert (
        np.isnan(grid.height(np.array([[9.0, 0.0]]))).all() and not grid.steppable(np.array([[9.0, 0.0]]), 0.02).any()
    )


def test_a_grid_keeps_what_it_knows_as_the_robot_moves() -> None:
    grid = known(plane, noise_m=0.01)
    before = grid.height(POINTS)
    for x in np.linspace(0.0, 0.6, 30):
        grid.update(0.0, np.array([x, 0.5 * x, *POSE[2:]]))
    np.testing.assert_allclose(grid.height(POINTS)[POINTS[:, 0] > 0.0], before[POINTS[:, 0] > 0.0], atol=1e-12)
    assert np.std(before - plane(POINTS)) == pytest.approx(0.01 * 2.0 / 3.0, rel=0.2)  # of four heights, bilinear


def test_errors_of_a_known_map_are_those_of_its_settings() -> None:
    moved = known(step, offset_m=(0.05, 0.0, 0.01))
    np.testing.assert_allclose(moved.height(np.array([[0.12, 0.0], [0.17, 0.0]])), [0.01, 0.06], atol=1e-12)
    drifting = known(plane, drift_m_per_m=0.1)
    for x in np.linspace(0.0, 3.0, 100):
        drifting.update(0.0, np.array([x, 0.0, *POSE[2:]]))
    error = drifting.height(np.array([[3.5, 0.0]])) - plane(np.array([[3.5, 0.0]]))
    assert 0.0 < abs(float(error[0])) < 0.3 * math.hypot(0.3, 0.2)


def test_a_map_of_what_is_seen_is_in_the_frame_of_the_estimate() -> None:
    seen = np.column_stack([np.repeat(np.arange(0.2, 0.6, 0.008), 50), np.tile(np.arange(-0.2, 0.2, 0.008), 50)])
    points = np.column_stack([seen, step(seen) - 0.25])
    estimate = np.array([1.0, 2.0, 0.30, 0.0, 0.0, math.sin(0.2), math.cos(0.2)])
    grid = SeenMap(lambda: points, SeenMapSettings(), 0.24)
    grid.update(0.0, estimate)
    c, s = math.cos(0.4), math.sin(0.4)
    at = np.array([[0.45, 0.0], [0.3, 0.1]]) @ [[c, s], [-s, c]] + estimate[:2]
    np.testing.assert_allclose(grid.height(at), 0.1, atol=1e-9)
    assert np.isnan(grid.height(np.array([[0.5, 2.0]]))).all()


@given(
    st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.integers(0, 3),
    st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)), max_size=3),
)  # fmt: skip
@settings(max_examples=12, deadline=None)
def test_the_foothold_is_the_nearest_point_of_the_patch_that_serves(
    legs: LegGeometry, x: float, y: float, v: float, foot: int, near: list[tuple[float, float]]
) -> None:
    elevation = Analytic()
    belief, planner = believed(legs, elevation), FootholdPlanner(legs)
    nominal = legs.feet[foot, :2] + [0.3 * x, 0.3 * y]
    others = nominal + np.array(near).reshape(-1, 2)
    motion = BaseMotion(0.0, 0.0, v, 0.0, 0.0, commanded_vx=v)
    places, normals = belief.choose(planner, motion, [foot], nominal[None], np.array([0.1]), 0.2, others)
    served = []
    longest = 0.92 * legs.length[foot]
    for offset in belief._patch:  # one at a time, as the docstring has it
        point = nominal + offset
        ground = float(elevation.height(point[None])[0])
        flat = elevation.steppable(point[None], belief.radius)[0]
        clear = all(math.dist(point, other) >= planner.spacing - 1e-9 for other in others)
        hips = [legs.hips[foot] + [v * t, 0.0, legs.height] for t in (0.1, 0.3)]
        near_enough = all(
            math.dist([*point, ground], hip) <= max(longest, math.dist([*nominal, 0.0], hip) + 1e-9) for hip in hips
        )
        knee = legs.knees[foot] - legs.feet[foot]
        shank = all(
            elevation.height((point + share * knee[:2])[None])[0] < ground + share * knee[2]
            for share in (0.4, 0.7, 1.0)
        )
        barely = elevation.steppable(point[None], legs.radius)[0] and clear
        levels = (flat and clear and near_enough and shank, barely and near_enough, barely)
        served.append((levels, math.hypot(*offset, ground)))  # the plane under the robot is level
    best = next((found for level in range(3) if (found := [far for levels, far in served if levels[level]])), [0.0])
    assert math.dist(places[0], [*nominal, 0.0]) == pytest.approx(min(best), abs=1e-9)
    np.testing.assert_array_equal(normals[0], [0.0, 0.0, 1.0])


@pytest.mark.parametrize(("yaw", "at"), [(0.7, (0.0, 0.0)), (0.0, (3.0, -1.0)), (-2.0, (-5.0, 9.0))])
def test_footholds_move_with_the_map(legs: LegGeometry, yaw: float, at: tuple[float, float]) -> None:
    planner, remaining = FootholdPlanner(legs), np.full(4, 0.1)
    nominal = legs.feet[:, :2] + [0.03, 0.02]
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, s], [-s, c]])
    pose = np.array([*at, 0.25, 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)])
    here, _ = believed(legs, Analytic()).choose(
        planner, BaseMotion(0.0, 0.0, 0.2, 0.0, 0.0, commanded_vx=0.2), range(4), nominal, remaining, 0.2
    )
    there, _ = believed(legs, Analytic(yaw, at), pose).choose(
        planner, BaseMotion(*at, 0.2 * c, 0.2 * s, yaw, commanded_vx=0.2 * c, commanded_vy=0.2 * s), range(4),
        nominal @ turn + at, remaining, 0.2,
    )  # fmt: skip
    np.testing.assert_allclose(there[:, :2], here[:, :2] @ turn + at, atol=1e-9)
    np.testing.assert_allclose(there[:, 2], here[:, 2], atol=1e-9)


def stairs(points: Array) -> Array:
    """Steps of 5 cm every 12 cm from x = 0.2 on."""
    return 0.05 * np.clip(np.floor((points[:, 0] - 0.2) / 0.12) + 1.0, 0.0, 9.0)


def aimed(belief: MappedBelief, legs: LegGeometry, x: float, time: float, leeway: float | None = None) -> list[float]:
    motion = BaseMotion(x - float(legs.feet[0, 0]), 0.0, 0.0, 0.0, 0.0)
    nominal = (x, float(legs.feet[0, 1]))
    return belief.aim(0, time, FootholdPlanner(legs), motion, nominal, 0.1, 0.2, [], leeway)


def test_a_lower_step_is_preferred_to_a_higher_one_that_is_as_near(legs: LegGeometry) -> None:
    belief = believed(legs, known(stairs))
    for edge in (0.2, 0.32):
        foothold = aimed(belief, legs, edge + 0.01, 0.0)
        assert foothold[0] < edge < foothold[0] + 0.1


def test_a_swing_stays_with_its_step_and_the_next_one_does_not(legs: LegGeometry) -> None:
    belief = believed(legs, known(stairs))
    first = aimed(belief, legs, 0.26, 0.0)
    assert first[2] == pytest.approx(0.05)
    assert aimed(belief, legs, 0.26 + 0.2 * belief.cell, 0.01, math.inf) == first
    assert aimed(belief, legs, 0.4, 0.02, math.inf)[2] == pytest.approx(0.05)
    assert aimed(belief, legs, 0.4, 0.03)[2] == pytest.approx(0.1)


def stones(points: Array) -> Array:
    """Ground up to x = 0.2, and from x = 0.26 on."""
    return np.where((points[:, 0] > 0.2) & (points[:, 0] < 0.26), -0.3, 0.0)


def test_a_swing_takes_another_foothold_only_within_its_leeway(legs: LegGeometry) -> None:
    belief = believed(legs, known(stones))
    first = aimed(belief, legs, 0.3, 0.0)
    assert first[0] > 0.26
    kept = aimed(belief, legs, 0.18, 0.01, leeway=0.02)
    assert 0.26 < kept[0] <= first[0]
    assert math.dist(kept, first) <= 0.02
    assert aimed(belief, legs, 0.17, 0.02, leeway=0.3)[0] < 0.2


def test_what_a_map_knows_to_be_lower_holds_no_foot(legs: LegGeometry) -> None:
    belief = believed(legs, known(step))
    ahead, back = [0.5, 0.1, 0.0], [-0.5, 0.1, 0.0]
    assert belief.holds([0.06, 0.0, 0.02], ahead)
    assert not belief.holds([0.06, 0.0, 0.02], back)
    assert not belief.holds([0.06, 0.0, 0.06], ahead)
    assert not belief.holds([0.0, 0.0, 0.02], ahead)
    assert belief.holds([9.0, 0.0, 0.02], ahead)  # nothing is known there


def test_feet_that_are_points_have_normals(legs: LegGeometry) -> None:
    points = replace(legs, radius=0.0)
    nominal = points.feet[:, :2]
    _, normals = believed(points, known(plane)).choose(
        FootholdPlanner(points), BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0), range(4), nominal, np.zeros(4), 0.2
    )
    expected = np.array([-0.3, 0.2, 1.0]) / math.sqrt(1.13)
    np.testing.assert_allclose(normals, np.tile(expected, (4, 1)), atol=1e-9)


class Column(Analytic):
    def height(self, points: Array) -> Array:
        return np.zeros((len(points), 1))


def test_a_map_of_the_wrong_shape_is_an_error() -> None:
    config = load_config("solo12_stairs_map")
    controller = build_controller(config, build_robot(config), world=World(), pose=lambda: POSE)
    with pytest.raises(InputError, match=r"shape \(2, 1\).*from height.*expected one of shape \(2,\)"):
        controller.feet.read_map(Column(), POSE)
    with pytest.raises(InputError, match="kind: got 'known' without a simulated world; expected 'none' or 'own'"):
        build_controller(config, build_robot(config))
    own = f"locomotion.terrain.map={{kind: own, use: '{__name__}:Nothing'}}"
    with pytest.raises(InputError, match="kind"):
        load_config("solo12_stairs_map", ["locomotion.terrain.map=knwon"])
    with pytest.raises(InputError, match="which returns Nothing; expected an object with update, height and steppable"):
        build_controller(load_config("solo12_stairs_map", [own]), build_robot(config))


class Nothing:
    """No map."""


def test_the_offset_of_a_map_in_height_is_measured_by_the_feet(legs: LegGeometry) -> None:
    belief = believed(legs, known(plane, offset_m=(0.0, 0.0, 0.02)))
    feet = legs.feet[:, :2]
    points = np.column_stack([feet, plane(feet)])
    belief.look(0.0, BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0))
    for _ in range(400):
        belief.update(5e-3, points, [True] * 4)
    assert belief.offset == pytest.approx(0.02, abs=1e-9)
    np.testing.assert_allclose(belief.slope, [0.3, -0.2], atol=1e-6)
    assert belief.height_at(0.4, 0.1) == pytest.approx(float(plane(np.array([[0.4, 0.1]]))[0]), abs=1e-6)
