"""Legged problems on a world: distances of bodies against the world's own, footholds at its heights, invariance."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.costs import StageSymbols
from lgmpc.errors import InputError
from lgmpc.problems import Scenario, build_jump
from lgmpc.problems.ground import BodySpheres, GroundDistance, ProblemGround
from lgmpc.problems.legged_settings import JumpSettings
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.world import Box, HeightField, Plane, World
from tests.support.displaced import Displacement

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
STEP = {"kind": "stairs", "steps": 1, "rise_m": 0.1, "ahead_m": 0.25, "tread_m": 1.0}


@lru_cache
def solo12() -> Robot:
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=FEET,
            contact_radius_m=0.016,
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad={"*_HAA": (-0.9, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)},
            posture="standing",
            armature_kg_m2=3.6e-4,
            collision_shapes=(
                {"kind": "sphere", "link": "*_LOWER_LEG", "radius_m": 0.012},
                {"kind": "box", "link": "base_link", "half_size_m": (0.20, 0.08, 0.03)},
            ),
        )
    )


def jump(robot: Robot | None = None, **settings: object) -> Scenario:
    return build_jump(
        robot or solo12(), JumpSettings(takeoff_s=0.2, flight_s=0.3, landing_s=0.2, step_s=0.02, **settings)
    )


def anywhere(seed: int, count: int) -> np.ndarray:
    """States with the base near a box, some of them deep in it."""
    rng, robot = np.random.default_rng(seed), solo12()
    xs = np.tile(robot.x_reference, (count, 1))
    for x in xs:
        x[: robot.nq] = pin.integrate(robot.model, robot.q_reference, 0.4 * rng.standard_normal(robot.nv))
    return xs


def test_the_optimised_distances_are_those_of_the_world() -> None:
    robot = solo12()
    world = World(
        (Plane(), Box((0.3, 0.1, 0.05), (0.1, 0.2, 0.05), (0.1, -0.2, 0.7)), Box((-0.2, 0.0, 0.0), (0.05, 1.0, 0.02)))
    )
    spheres, xs = BodySpheres.optimised(robot), anywhere(3, 20)
    planes, boxes, solids = ProblemGround(world).solids(spheres, xs)
    assert (planes, boxes) == (1, 2)
    distance = GroundDistance(spheres, planes, boxes)
    x, p = ca.SX.sym("x", robot.nq + robot.nv), ca.SX.sym("p", solids.size)
    function = ca.Function("distance", [x, p], [distance.expression(StageSymbols(robot.symbolic, x, {"solids": p}))])
    found = np.array([function(each, solids).full().ravel() for each in xs])
    truth = spheres.distances(robot, xs, world)
    near = truth < 0.1  # farther away the world's distances are heights
    assert near.sum() > 200 and (truth < -0.02).sum() > 20
    np.testing.assert_allclose(found[near], truth[near], atol=1e-12)


def test_footholds_and_base_are_at_the_heights_of_the_ground() -> None:
    scenario, flat = jump(displacement_m=(0.5, 0.0, 0.0), world=STEP), jump(displacement_m=(0.5, 0.0, 0.0))
    rises = [on.position - below.position for on, below in zip(scenario.waypoints, flat.waypoints, strict=True)]
    np.testing.assert_allclose(rises, np.tile([0.0, 0.0, 0.1], (4, 1)), atol=1e-12)
    moved = scenario.guess.xs[-1] - flat.guess.xs[-1]
    np.testing.assert_allclose(moved[:3], [0.0, 0.0, 0.1], atol=1e-12)
    # The jump's reference on the box is that of a jump by as much upwards.
    up = jump(displacement_m=(0.5, 0.0, 0.1))
    np.testing.assert_allclose(scenario.guess.xs[11:], up.guess.xs[11:], atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ahead_m": 0.31}, r"world: got a foothold at \[0\.3\d*, -?0\.\d+\] m, on an edge or a slope"),
        ({"kind": "ramp", "angle_deg": 15.0}, "on an edge or a slope; expected footholds on flat ground parallel"),
    ],
)
def test_a_foothold_on_an_edge_is_one_error(changes: dict[str, object], words: str) -> None:
    world = {**STEP, **changes} if "kind" not in changes else {**changes, "ahead_m": 0.25}
    with pytest.raises(InputError, match=words):
        jump(displacement_m=(0.5, 0.0, 0.0), world=world)


def test_a_height_field_is_refused() -> None:
    with pytest.raises(InputError, match="a HeightField; expected a world of planes and boxes"):
        ProblemGround(World((HeightField(np.zeros((3, 3)), 0.1),)))


def test_the_figures_see_bodies_in_the_ground() -> None:
    scenario = jump()
    guess, sunk = scenario.guess, replace(scenario.guess, xs=scenario.guess.xs - np.eye(1, 37, 2) * 0.12)
    standing, deep = scenario.figures(guess), scenario.figures(sunk)
    assert standing["foot_depth_m"] == 0.0 and standing["clearance_m"] > 0.02
    assert deep["clearance_m"] == pytest.approx(standing["clearance_m"] - 0.12, abs=1e-12)
    assert deep["foot_depth_m"] == pytest.approx(0.12, abs=1e-3)  # at the first moment in the air


@pytest.mark.parametrize("kind", [{"kind": "stairs", "steps": 1, "rise_m": 0.1, "width_m": 20.0}, {"kind": "slope"}])
def test_the_problem_is_the_same_anywhere(kind: dict[str, object]) -> None:
    """Turned, shifted and raised with its world, or tilted with gravity: figures, distances and references agree."""
    world = {**kind, "start_m": (0.1, -0.2), "start_yaw_deg": 25.0, "height_m": 0.7}
    world |= {"ahead_m": 0.6, "tread_m": 1.0} if kind["kind"] == "stairs" else {}
    there = Displacement(*JumpSettings(world=world).ground().start_pose)
    settings, moved = {"displacement_m": (0.1, 0.0, 0.0)}, there.robot(solo12())
    here, displaced = jump(**settings), jump(moved, **settings, world=world)
    ours, theirs = here.figures(here.guess), displaced.figures(displaced.guess)
    assert ours["com_rise_m"] > 0.1 and ours["swing_height_m"] > 0.02
    for name, value in ours.items():
        assert theirs[name] == pytest.approx(value, abs=1e-6), name
    np.testing.assert_allclose(displaced.guess.xs[:, :3], there.points(here.guess.xs[:, :3]), atol=1e-12)
    np.testing.assert_allclose(displaced.guess.xs[:, 7:], here.guess.xs[:, 7:], atol=1e-12)
    np.testing.assert_allclose(displaced.guess.us, here.guess.us, atol=1e-9)
