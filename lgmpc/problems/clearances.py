"""Pairs of shapes that keep a distance: parts of a robot from each other, or from objects in the world."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import ShapePairDistance
from lgmpc.errors import InputError
from lgmpc.robot import Box, CollisionShape, Robot, Sphere, place_shape
from lgmpc.robot.collision import AnyShape
from lgmpc.settings import NonNegative, Positive, Settings
from lgmpc.typing import Array

__all__ = ["Clearance", "clearance_items", "least_clearance"]


class Clearance(Settings):
    """Two spheres or capsules, or a sphere and a box, that keep a distance."""

    first: AnyShape = Field(description="A shape on a frame of the robot; a sphere if the other one is a box.")
    second: AnyShape = Field(description="A shape on another link, or of the world (link: universe).")
    distance_m: NonNegative = Field(default=0.02, description="Least distance of their surfaces, m.")
    weight: Positive | None = Field(
        default=None,
        description="Weight of the squared shortfall of the distance in the cost, 1/m2. null: a hard constraint, for "
        "sqp, al_fddp, ipopt or fatrop.",
    )


def clearance_items(robot: Robot, clearances: Sequence[Clearance]) -> tuple[list[CostItem], list[ConstraintItem]]:
    """Return the costs and constraints of clearances.

    Raises:
        InputError: an unknown frame, two shapes on the same joint, or a box and a shape other than a sphere.
    """
    costs, constraints = [], []
    for i, (clearance, pair) in enumerate(zip(clearances, _pairs(robot, clearances), strict=True)):
        try:
            distance = ShapePairDistance(*pair)
        except InputError as error:
            raise InputError(f"clearances.{i}", error.got, error.expected) from error
        name = f"clearance_{i}"
        if clearance.weight is None:
            constraints.append(ConstraintItem(name, distance, clearance.distance_m, np.inf))
        else:
            costs.append(CostItem(name, distance, clearance.weight, QuadraticBarrier(clearance.distance_m, np.inf)))
    return costs, constraints


def least_clearance(robot: Robot, clearances: Sequence[Clearance], xs: Array) -> float:
    """Return the least distance of all pairs at states (n, nx), by coal, m; negative where they overlap."""
    data, request, result = robot.create_data(), coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    least = np.inf
    for first, second in _pairs(robot, clearances):
        for x in xs:
            pin.forwardKinematics(robot.model, data, x[: robot.nq])
            places = []
            for part in (first, second):
                place = data.oMi[part.joint] * part.placement
                places += [_geometry(part), coal.Transform3s(place.rotation, place.translation)]
            result.clear()
            least = min(least, coal.distance(*places, request, result))
    return float(least)


def _pairs(robot: Robot, clearances: Sequence[Clearance]) -> list[tuple[CollisionShape, CollisionShape]]:
    return [
        (_place(robot, f"clearances.{i}.first", each.first), _place(robot, f"clearances.{i}.second", each.second))
        for i, each in enumerate(clearances)
    ]


def _place(robot: Robot, key: str, shape: AnyShape) -> CollisionShape:
    try:
        return place_shape(robot.model, shape)
    except InputError as error:
        raise InputError(f"{key}.link", error.got, error.expected, error.choices) from error


def _geometry(part: CollisionShape) -> coal.CollisionGeometry:
    shape = part.shape
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius_m)
    if isinstance(shape, Box):
        return coal.Box(*(2.0 * half for half in shape.half_size_m))
    return coal.Capsule(shape.radius_m, 2.0 * shape.half_length_m)
