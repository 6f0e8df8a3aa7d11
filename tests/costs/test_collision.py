"""Distances of shapes against coal's, their derivatives against central differences, at seams too."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import coal
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import FreeForwardDynamics, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem, StageSymbols
from lgmpc.costs.library import Control, ShapePairDistance, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem
from lgmpc.robot import Box, Capsule, CollisionShape, Sphere, place_shape, shape_of
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.solvers import LineSearchSqp


@lru_cache
def arm() -> tuple[pin.Model, pin.GeometryModel]:
    """A manipulator with a capsule on each of three links, a sphere at its hand, a capsule and a ball in its way."""
    model, geometry, rng = pin.buildSampleModelManipulator(), pin.GeometryModel(), np.random.default_rng(3)
    shapes = [
        ("upper", 2, coal.Capsule(0.06, 0.5)),
        ("fore", 4, coal.Capsule(0.05, 0.4)),
        ("wrist", 5, coal.Capsule(0.03, 0.1)),
        ("hand", 6, coal.Sphere(0.07)),
        ("post", 0, coal.Capsule(0.04, 1.2)),
        ("ball", 0, coal.Sphere(0.1)),
        ("step", 0, coal.Box(0.5, 0.3, 0.2)),
        ("case", 3, coal.Box(0.2, 0.1, 0.3)),
    ]
    for name, joint, shape in shapes:
        place = pin.SE3(pin.exp3(rng.standard_normal(3)), rng.uniform(-0.3, 0.3, 3))
        geometry.addGeometryObject(pin.GeometryObject(name, joint, place, shape))
    objects = geometry.geometryObjects
    boxes, spheres = {"step", "case"}, {"hand", "ball"}
    for i, one in enumerate(objects):
        for j in range(i):
            names = {one.name, objects[j].name}
            known = not names & boxes or bool(names & spheres)
            if known and one.parentJoint != objects[j].parentJoint:
                geometry.addCollisionPair(pin.CollisionPair(i, j))
    return model, geometry


def distance(model: pin.Model, first: CollisionShape, second: CollisionShape) -> ca.Function:
    """q -> (distance, its derivative in tangent coordinates)."""
    symbols, q, dq = SymbolicModel(model), ca.SX.sym("q", model.nq), ca.SX.sym("dq", model.nv)
    x = ca.vertcat(symbols.integrate(q, dq), ca.SX.zeros(model.nv))
    value = ShapePairDistance(first, second).expression(StageSymbols(symbols, x, {}))
    found = ca.Function("d", [q, dq], [value, ca.jacobian(value, dq)])
    return ca.Function("distance", [q], found(q, ca.SX.zeros(model.nv)))


def test_distances_of_all_pairs_are_coals() -> None:
    model, geometry = arm()
    data, geometry_data, rng = model.createData(), geometry.createData(), np.random.default_rng(0)
    objects = [shape_of(part) for part in geometry.geometryObjects]
    functions = [distance(model, objects[p.first], objects[p.second]) for p in geometry.collisionPairs]
    signs = set()
    for _ in range(100):
        q = rng.uniform(-np.pi, np.pi, model.nq)
        pin.computeDistances(model, data, geometry, geometry_data, q)
        for found, result in zip(functions, geometry_data.distanceResults, strict=True):
            value = float(found(q)[0])
            signs.add(np.sign(value))
            assert value == pytest.approx(result.min_distance, abs=1e-7)
    assert signs == {-1.0, 1.0}  # apart and overlapping


def test_derivatives_are_the_central_differences_of_the_distance() -> None:
    model, geometry = arm()
    objects, rng, h = [shape_of(part) for part in geometry.geometryObjects], np.random.default_rng(1), 1e-6
    for pair in geometry.collisionPairs:
        found = distance(model, objects[pair.first], objects[pair.second])
        for _ in range(20):
            q = rng.uniform(-np.pi, np.pi, model.nq)
            numeric = [float(found(q + e)[0] - found(q - e)[0]) / (2 * h) for e in h * np.eye(model.nv)]
            np.testing.assert_allclose(found(q)[1].full()[0], numeric, atol=1e-7)


def flying(half: float = 0.3) -> tuple[pin.Model, CollisionShape, CollisionShape]:
    """A free capsule, and one along the world's z axis."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(root, pin.Inertia.Random(), pin.SE3.Identity())
    mine = CollisionShape("mine", 1, pin.SE3.Identity(), Capsule(link="*", radius_m=0.05, half_length_m=half))
    post = CollisionShape("post", 0, pin.SE3.Identity(), Capsule(link="*", radius_m=0.1, half_length_m=0.5))
    return model, mine, post


def pose(translation: list[float], rotation: list[float]) -> np.ndarray:
    return pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array(rotation)), np.array(translation)))


@pytest.mark.parametrize(
    ("translation", "rotation"),
    [
        ([0.4, 0.1, 0.05], [0.0, 0.0, 0.0]),  # parallel, side by side
        ([0.4, 0.0, 0.8], [0.0, 0.0, 0.0]),  # parallel, end against end
        ([0.4, 0.0, 0.2], [0.0, 0.0, 0.0]),  # parallel, both upper ends level
        ([0.0, 0.0, 1.5], [0.0, 0.0, 0.0]),  # in line
        ([0.0, 0.5, 0.5], [0.0, np.pi / 2, 0.0]),  # across, level with an end
        ([0.3, 0.5, 0.0], [0.0, np.pi / 2, 0.0]),  # across, an end abreast of the axis
        ([0.4, 0.1, 0.05], [0.0, 1e-9, 0.0]),  # nearly parallel: below the least angle,
        ([0.4, 0.1, 0.05], [1e-7, 0.0, 0.0]),  # below it, the axes crossing
        ([0.4, 0.0, 0.0], [2e-6, 0.0, 0.0]),  # just above it
    ],
)
def test_at_seams_the_derivative_is_one_of_the_one_sided_ones(translation: list[float], rotation: list[float]) -> None:
    """In each direction the change is between those ahead and behind, and where these agree, equal to both."""
    model, mine, post = flying()
    found, q, rng, h = distance(model, mine, post), pose(translation, rotation), np.random.default_rng(2), 1e-6
    value, gradient = (each.full() for each in found(q))
    assert np.isfinite(gradient).all()
    data = coal.DistanceResult()
    shapes = [coal.Capsule(0.05, 0.6), coal.Capsule(0.1, 1.0)]
    place = pin.XYZQUATToSE3(q)
    coal.distance(
        shapes[0], coal.Transform3s(place.rotation, place.translation), shapes[1], coal.Transform3s.Identity(),
        coal.DistanceRequest(), data,
    )  # fmt: skip
    # coal takes axes less than 1e-6 askew as parallel, and the wrong end of two.
    assert float(value[0, 0]) == pytest.approx(data.min_distance, abs=2e-8)
    for _ in range(30):
        way = rng.standard_normal(6)
        ahead, behind = (
            sign * (float(found(pin.integrate(model, q, sign * h * way))[0]) - float(value[0, 0])) / h
            for sign in (1.0, -1.0)
        )
        slope = float(gradient[0] @ way)
        assert min(ahead, behind) - 1e-4 < slope < max(ahead, behind) + 1e-4


def test_where_axes_meet_the_derivative_is_zero() -> None:
    model, mine, post = flying()
    value, gradient = (each.full() for each in distance(model, mine, post)(pose([0, 0, 0], [0.3, 0.0, 0.0])))
    assert float(value[0, 0]) == pytest.approx(-0.15)
    np.testing.assert_array_equal(gradient, 0.0)


def test_an_arm_passes_an_obstacle_at_the_distance_that_a_constraint_requires() -> None:
    """Straight through the ball it would be shorter: the constraint is active, and coal measures the same distance."""
    model = pin.buildSampleModelManipulator()
    q0, goal, clearance = np.array([0.0, 0.8, 0.5, 0.0, 0.3, 0.0]), np.array([1.2, 0.8, 0.5, 0.0, 0.3, 0.0]), 0.03
    data = model.createData()
    pin.forwardKinematics(model, data, pin.interpolate(model, q0, goal, 0.5))
    hand = CollisionShape("hand", 6, pin.SE3.Identity(), Sphere(link="*", radius_m=0.05))
    ball = CollisionShape(
        "ball", 0, pin.SE3(np.eye(3), data.oMi[6].translation + [0.0, 0.0, 0.1]), Sphere(link="*", radius_m=0.1)
    )
    dynamics = FreeForwardDynamics(model)
    x_goal = np.concatenate([goal, np.zeros(model.nv)])
    costs = [CostItem("goal", StateError(dynamics.state, x_goal), 10.0), CostItem("effort", Control(model.nv), 1e-3)]
    apart = ConstraintItem("apart", ShapePairDistance(hand, ball), clearance, np.inf)
    problem = ShootingProblem(MultibodyAction("passing", dynamics, costs, [apart]), 20)
    problem.set("duration", 0.05)
    problem.set_initial_state(np.concatenate([q0, np.zeros(model.nv)]))
    solution = LineSearchSqp(problem).solve(problem.hold(), max_iterations=200)
    assert solution.status.solved, solution.explain()
    least = np.inf
    for x in solution.xs[:-1]:
        pin.forwardKinematics(model, data, x[: model.nq])
        least = min(least, float(np.linalg.norm(data.oMi[6].translation - ball.placement.translation)) - 0.15)
    assert least == pytest.approx(clearance, abs=1e-5)


def test_shapes_are_placed_on_frames_by_name() -> None:
    model = pin.buildSampleModelManipulator()
    name = model.frames[-1].name
    placed = place_shape(model, Capsule(link=name, center_m=(0, 0, 0.1), radius_m=0.02, half_length_m=0.1))
    frame = model.frames[-1]
    assert placed.joint == frame.parentJoint
    np.testing.assert_allclose(placed.placement.translation, frame.placement.act(np.array([0, 0, 0.1])))
    assert place_shape(model, Sphere(link="universe", radius_m=0.1)).joint == 0
    with pytest.raises(InputError, match="frame: got wrst2_body; expected a frame.*Did you mean wrist2_body"):
        place_shape(model, Sphere(link="wrst2_body", radius_m=0.1))


def test_shapes_without_a_distance_are_named() -> None:
    _, mine, post = flying()
    box, more = (CollisionShape(name, 0, pin.SE3.Identity(), Box(link="*", half_size_m=(0.1,) * 3)) for name in "ab")
    rod = CollisionShape("rod", 1, pin.SE3.Identity(), Capsule(link="*", radius_m=0.1, half_length_m=0.1))
    with pytest.raises(InputError, match="first: got 'rod', a capsule; expected a sphere, because 'a' is a box"):
        ShapePairDistance(rod, box)
    with pytest.raises(InputError, match="second: got 'rod', a capsule; expected a sphere, because 'b' is a box"):
        ShapePairDistance(more, rod)
    with pytest.raises(InputError, match="first, second: got 'mine', 'mine' on one joint; expected shapes"):
        ShapePairDistance(mine, mine)
    with pytest.raises(InputError, match="first: got str; expected a CollisionShape"):
        ShapePairDistance("hand", post)  # type: ignore[arg-type]
