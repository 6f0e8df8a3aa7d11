"""Both plants on ground that is not a level floor at the origin: displaced, inclined."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from pydantic import TypeAdapter

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.simulation.initial import initial_state
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.simulation.pinocchio import PinocchioPlant
from lgmpc.world import Box, FloorSettings, HeightField, Plane, SlopeSettings, World, WorldSettings, make_world

GRAVITY = 9.81
MU = 0.5
TOLERANCE = {MujocoPlant: 1e-12, PinocchioPlant: 1e-8}
"""Largest difference of a joint, rad, or a position, m, after 0.4 s: rounding, and the tolerance of Gauss-Seidel."""


def slope(degrees: float, uphill: float = 0.0) -> World:
    return make_world(SlopeSettings(angle_deg=degrees, uphill_deg=uphill), MU)


def named(section: Any) -> World:
    return make_world(TypeAdapter(WorldSettings).validate_python(section), MU)


def on(world: World, robot: Robot, settings: PlantSettings | None = None) -> np.ndarray:
    """The initial state, 10 um below the surface: whether MuJoCo has a contact does not depend on rounding."""
    x = initial_state(robot, settings or PlantSettings(), world)
    x[:3] -= 1e-5 * world.normal(x[None, :2])[0]
    return x


def test_a_displaced_world_with_its_gravity_gives_the_displaced_trajectory(plant_type, solo12, displacement) -> None:
    """Under joint impedance, with a push that slides feet."""
    settings, force, runs = PlantSettings(friction=MU), np.array([10.0, 14.0, 6.0, -0.8, 0.0, 0.2]), []
    floor = make_world(FloorSettings(), MU)
    for world, robot, push in (
        (floor, solo12, force),
        (displacement.world(floor), displacement.robot(solo12), displacement.vectors(force)),
    ):
        plant = plant_type(robot, settings, world)
        plant.reset(on(world, robot))
        samples = []
        for k in range(400):
            plant.set_wrench("base_link", push if 100 <= k < 300 else np.zeros(6))
            now = plant.sense()
            plant.step(8.0 * (solo12.q_reference[7:] - now.q[7:]) - 0.2 * now.v[6:])
            samples.append(plant.sense())
        runs.append([np.array([getattr(each, name) for each in samples]) for name in ("q", "v", "contact_forces")])
    (q, v, forces), (moved_q, moved_v, moved_forces) = runs
    assert np.abs(q[-1, :2] - q[0, :2]).max() > 0.01
    expected = displacement.poses(q)
    expected[:, 3:7] *= np.sign(np.sum(expected[:, 3:7] * moved_q[:, 3:7], axis=1))[:, None]
    scale = TOLERANCE[plant_type]
    np.testing.assert_allclose(moved_q, expected, rtol=0, atol=scale)
    np.testing.assert_allclose(moved_v, v, rtol=0, atol=1e2 * scale)
    np.testing.assert_allclose(moved_forces, displacement.vectors(forces), rtol=0, atol=1e3 * scale)


@pytest.mark.parametrize("uphill", [0.0, 130.0])
def test_a_block_stays_below_the_angle_of_friction_and_slides_above(plant_type, block, uphill) -> None:
    """Coulomb: it slides downhill with g (sin a - mu cos a)."""
    limit, steps = math.degrees(math.atan(MU)), 400
    downhill = -np.array([math.cos(math.radians(uphill)), math.sin(math.radians(uphill))])
    for degrees, slides in ((limit - 1.0, False), (limit + 4.0, True)):
        world, angle = slope(degrees, uphill), math.radians(degrees)
        plant = plant_type(block, PlantSettings(friction=MU), world)
        plant.reset(on(world, block))
        for _ in range(100):
            plant.step(np.zeros(0))
        start = plant.sense()
        force = np.zeros(3)
        for _ in range(steps):
            plant.step(np.zeros(0))
            force += plant.sense().contact_forces.sum(axis=0) / steps
        end, seconds = plant.sense(), steps * plant.dt
        moved = end.q[:3] - start.q[:3]
        normal = world.normal(np.zeros((1, 2)))[0]
        # A block that chatters ends with up to 4 cm/s along the normal: 2 % of the impulse.
        assert force @ normal == pytest.approx(block.mass * GRAVITY * math.cos(angle), rel=0.02)
        if not slides:
            assert np.linalg.norm(moved) < 5e-4 * seconds  # MuJoCo's soft contacts creep; rigid ones do not
            continue
        acceleration = GRAVITY * (math.sin(angle) - MU * math.cos(angle))
        speed = np.linalg.norm(pin.Quaternion(start.q[3:7]).matrix() @ start.v[:3])
        distance = speed * seconds + acceleration * seconds**2 / 2
        # MuJoCo's soft contacts chatter under a sliding block: some percent in the friction.
        np.testing.assert_allclose(moved[:2], distance * math.cos(angle) * downhill, rtol=0, atol=0.1 * distance)
        assert abs(moved @ normal) < 1e-3


def test_standing_on_a_slope_agrees(solo12, hold) -> None:
    """The base to 1 mm, feet's forces along the normal to 0.3 N of 6 after two seconds under impedance."""
    world, samples = slope(12.0, 40.0), []
    normal = world.normal(np.zeros((1, 2)))[0]
    for plant_type in (MujocoPlant, PinocchioPlant):
        plant = plant_type(solo12, PlantSettings(friction=MU), world)
        plant.reset(on(world, solo12))
        hold(plant, solo12, 2000)
        samples.append(plant.sense())
    np.testing.assert_allclose(samples[0].q[:3], samples[1].q[:3], rtol=0, atol=1e-3)
    np.testing.assert_allclose(samples[0].contact_forces @ normal, samples[1].contact_forces @ normal, atol=0.3, rtol=0)
    weight = np.array([0.0, 0.0, solo12.mass * GRAVITY])
    for sample in samples:
        np.testing.assert_allclose(sample.contact_forces.sum(axis=0), weight, rtol=0, atol=0.05)


@pytest.mark.parametrize("posture", ["reference", "lying", {"F?_HFE": 1.4, "H?_HFE": -1.4, "*_KFE": 0.0}])
def test_every_initial_posture_lies_on_the_ground(solo12, posture) -> None:
    """The spheres of feet and shapes are as far from a slope as from a floor; joints and velocities are the same."""
    settings = PlantSettings(initial_posture=posture, initial_velocity_m_s=(0.3, 0.0, 0.0))
    level, world = initial_state(solo12, settings), make_world(SlopeSettings(angle_deg=20.0, start_m=(1.0, 2.0)), MU)
    state = initial_state(solo12, settings, world)
    np.testing.assert_array_equal(state[7:], level[7:])
    assert state[:2] == pytest.approx([1.0, 2.0], abs=0.2)
    data, gaps = solo12.create_data(), []
    for x, ground in ((level, World()), (state, world)):
        pin.framesForwardKinematics(solo12.model, data, x[: solo12.nq])
        spheres = [(data.oMf[i].translation, solo12.contact_radius) for i in solo12.contact_ids]
        spheres += [((data.oMi[p.joint] * at).translation, r) for p in solo12.collision_shapes for at, r in p.corners]
        centres, radii = map(np.array, zip(*spheres, strict=True))
        gaps.append(ground.distance(centres)[0] - radii)
    np.testing.assert_allclose(gaps[0], gaps[1], rtol=0, atol=1e-12)


def test_the_friction_is_that_of_the_surface(plant_type, block) -> None:
    """The world's coefficient acts, not that of the parameters: on 0.2, a push of 0.3 of the weight moves the block."""
    moved = []
    for coefficient in (0.2, 0.5):
        plant = plant_type(block, PlantSettings(friction=1.0), World((Plane(coefficient=coefficient),)))
        plant.set_wrench("block", np.array([0.3 * block.mass * GRAVITY, 0, 0, 0, 0, 0]))
        for _ in range(300):
            plant.step(np.zeros(0))
        moved.append(plant.sense().q[0])
    assert moved[0] == pytest.approx(0.1 * GRAVITY * 0.3**2 / 2, rel=0.15)
    assert abs(moved[1]) < 1e-4


@pytest.mark.parametrize("seam", [0.0, 1.0], ids=["on a seam", "on one box"])
def test_standing_on_boxes_is_standing_on_a_floor(plant_type, solo12, hold, seam) -> None:
    """Level tops carry every foot with the same force as the floor, upward, also where two boxes meet below it."""
    boxes = (Box((seam - 1.0, 0, -0.5), (1.0, 1, 0.5), coefficient=MU), Box((seam + 1.0, 0, -0.5), (1.0, 1, 0.5)))
    samples = []
    for world in (World((Plane(coefficient=MU),)), World((Plane((0, 0, -1.0)), *boxes))):
        plant = plant_type(solo12, PlantSettings(friction=MU), world)
        x = on(world, solo12)
        x[0] += solo12.q_reference[0] + 0.19  # front feet at x = 0.38
        plant.reset(x)
        hold(plant, solo12, 300)
        samples.append(plant.sense())
    np.testing.assert_allclose(samples[0].q, samples[1].q, rtol=0, atol=1e-6)
    np.testing.assert_allclose(samples[0].contact_forces, samples[1].contact_forces, rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ({"kind": "stairs", "rise_m": 0.5}, "world.rise_m"),
        ([{"kind": "ramp"}, {"kind": "blocks", "max_height_m": 0.4}], "world.parts.1.max_height_m"),
    ],
)
def test_steps_higher_than_the_legs_are_refused(solo12: Robot, section: Any, key: str) -> None:
    with pytest.raises(
        InputError, match=rf"{key}: got 0\.[45]; expected at most 0\.2.*, m, the height at which solo12"
    ):
        initial_state(solo12, PlantSettings(), named(section))


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"kind": "blocks", "ahead_m": 0.1}, "reaches [0-9]+ mm into the ground"),
        ({"kind": "gaps", "ahead_m": 0.16, "gap_m": 0.3}, "reaches [0-9]+ mm above a hole"),
        ({"kind": "stairs", "ahead_m": 3.0, "start_m": [3.0, 0.0]}, "reaches 50 mm above a hole"),
    ],
)
def test_a_start_on_an_edge_is_refused(solo12: Robot, section: Any, words: str) -> None:
    with pytest.raises(InputError, match=rf"world.start_m: got .*{words}; expected a start on flat ground: .*ahead_m"):
        initial_state(solo12, PlantSettings(), named(section))


def test_a_start_elsewhere_on_flat_ground_is_accepted(solo12: Robot) -> None:
    state = initial_state(solo12, PlantSettings(), named({"kind": "stairs", "start_m": [2.6, 0.0]}))
    level = initial_state(solo12, PlantSettings(), World((Plane(),)))
    np.testing.assert_allclose(state[:3], level[:3] + [2.6, 0.0, 0.25], atol=1e-12)


INCLINE = math.radians(30.0)
RISING = 0.1 * math.tan(INCLINE) * np.arange(-20, 21)
SAME_PLANE = {
    "box": Box((0.05 * math.sin(INCLINE), 0.0, -0.05 * math.cos(INCLINE)), (2, 2, 0.05), (0.0, -INCLINE, 0.0), MU),
    "height field": HeightField(np.tile(RISING, (21, 1)), 0.1, (-2.0, -1.0), MU),
}


@pytest.mark.parametrize("surface", SAME_PLANE)
def test_a_block_slides_down_every_surface_as_down_a_plane(plant_type, block, surface) -> None:
    """g (sin a - mu cos a), on an inclined plane of 30 degrees that is one of each kind."""
    if plant_type is MujocoPlant and surface == "height field" and block.contact_radius == 0.0:
        pytest.skip("points catch on the edges of MuJoCo's triangles: feet on height fields need a radius")
    ends = []
    for world in (slope(30.0), World((Plane((0.0, 0.0, -9.0)), SAME_PLANE[surface]))):
        plant = plant_type(block, PlantSettings(friction=MU), world)
        plant.reset(on(world, block))
        for _ in range(300):
            plant.step(np.zeros(0))
        ends.append(plant.sense().q[:3])
    moved = math.hypot(*(ends[0][[0, 2]] - [0.0, 0.035 * math.cos(INCLINE)]))
    assert moved > 0.02
    # MuJoCo's soft contacts chatter under a sliding block: some percent in the friction. Pinocchio's solver: below a
    # micrometre, with the oldest version 0.15 mm of 38.
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=(0.01 if plant_type is PinocchioPlant else 0.1) * moved)


@pytest.mark.parametrize(
    "world",
    [
        pytest.param("blocks_30mm", id="blocks"),
        pytest.param("hills_80mm", id="hills"),
        pytest.param({"kind": "ramp", "angle_deg": 12.0}, id="ramp"),
    ],
)
def test_a_robot_dropped_on_rough_ground_comes_to_rest_alike(solo12, hold, world) -> None:
    """From 1 cm above, under impedance: the base to 4 mm, forces to the weight, feet on the ground and not in it."""
    ground, samples = named(world), []
    x = np.concatenate([solo12.q_reference, np.zeros(solo12.nv)])
    x[0], x[1] = 1.7, 0.04
    data = solo12.create_data()
    for plant_type in (MujocoPlant, PinocchioPlant):
        pin.framesForwardKinematics(solo12.model, data, x[: solo12.nq])
        centres = np.array([data.oMf[i].translation for i in solo12.contact_ids])
        x[2] -= (ground.distance(centres)[0] - solo12.contact_radius).min() - 0.01
        plant = plant_type(solo12, PlantSettings(friction=0.8), ground)
        plant.reset(x)
        hold(plant, solo12, 1200)
        samples.append(plant.sense())
        pin.framesForwardKinematics(solo12.model, data, samples[-1].q)
        gaps = ground.distance(np.array([data.oMf[i].translation for i in solo12.contact_ids]))[0]
        loaded = np.linalg.norm(samples[-1].contact_forces, axis=1) > 0.5
        assert loaded.sum() >= 3
        np.testing.assert_allclose(gaps[loaded], solo12.contact_radius, rtol=0, atol=1e-3)
    for sample in samples:
        np.testing.assert_allclose(sample.contact_forces.sum(axis=0), [0, 0, solo12.mass * GRAVITY], rtol=0, atol=0.5)
    np.testing.assert_allclose(samples[0].q[:3], samples[1].q[:3], rtol=0, atol=4e-3)


def test_soft_ground_is_a_spring_with_a_damper_in_both_plants(solo12, hold) -> None:
    """A robot on its feet sinks in by its weight over the stiffness, on the same way down in both plants."""
    soft = {"stiffness_n_m": 3000.0, "damping_ns_m": 20.0}
    world, paths, data = named({"kind": "floor", "soft": soft}), [], solo12.create_data()
    for plant_type in (MujocoPlant, PinocchioPlant):
        plant = plant_type(solo12, PlantSettings(), world)
        plant.reset(initial_state(solo12, PlantSettings(), world))
        paths.append([])
        for _ in range(60):
            hold(plant, solo12, 5)
            paths[-1].append(plant.sense().q[2])
        hold(plant, solo12, 1200)
        sample = plant.sense()
        pin.framesForwardKinematics(solo12.model, data, sample.q)
        depths = solo12.contact_radius - np.array([data.oMf[i].translation[2] for i in solo12.contact_ids])
        np.testing.assert_allclose(depths, sample.contact_forces[:, 2] / soft["stiffness_n_m"], rtol=1e-3)
        np.testing.assert_allclose(depths.sum(), solo12.mass * GRAVITY / soft["stiffness_n_m"], rtol=1e-3)
    assert np.ptp(paths[0]) > 2e-3
    np.testing.assert_allclose(paths[0], paths[1], rtol=0, atol=5e-5)


def test_a_plant_resumed_on_a_slope_continues(plant_type, solo12, hold) -> None:
    """From its sample, another plant of the world takes the same steps, to the tolerance of the contact solvers."""
    world, settings = slope(12.0, 40.0), PlantSettings(friction=MU)
    plants = [plant_type(solo12, settings, world) for _ in range(2)]
    plants[0].reset(on(world, solo12))
    hold(plants[0], solo12, 200)
    plants[1].resume(plants[0].sense())
    np.testing.assert_array_equal(plants[1].sense().contact_forces, plants[0].sense().contact_forces)
    for plant in plants:
        hold(plant, solo12, 20)
    for name, tolerance in (("q", 1e-8), ("v", 1e-6), ("contact_forces", 1e-4)):
        first, second = (getattr(plant.sense(), name) for plant in plants)
        np.testing.assert_allclose(second, first, rtol=0, atol=tolerance, err_msg=name)
