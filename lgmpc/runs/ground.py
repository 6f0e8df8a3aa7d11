"""Positions of feet and base relative to the ground: the one module of this package that knows where a foot touches."""

import math

import numpy as np

from lgmpc.typing import Array
from lgmpc.world import World

_TOUCHING = 2e-3
"""Distance from a foot, m, up to which a surface may exert a force on it that was measured one tick before."""
_FELT_N = 1e-3
"""Forces below this one have no direction, N."""
_ACROSS, _DEEPEST = 0.7, 1.5
"""Radius of the ground that a robot is above, and its lowest depth below the base, in lengths of a leg."""
_DIRECTIONS = np.arange(8) * (2.0 * math.pi / 8)
_FACETS = np.arange(16) * (2.0 * math.pi / 16)
_AROUND = np.concatenate(
    [[[0.0, 0.0]], *(r * np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)]) for r in (0.5, 1.0))]
)
"""(17, 2) points of a disc of radius 1."""


def ground_channels(
    world: World, radius: float, base: Array, points: Array, normals: Array, forces: Array
) -> dict[str, Array]:
    """Return the channels of a log that relate to the ground, by name.

    A spherical foot of this radius with its centre at c touches a surface of unit normal m at ``c - radius m``. One
    that touches several, such as a step and its riser, is pressed by each along its own normal: its normal is the
    direction of those forces' sum, by non-negative least squares. Normals are those at the time of the forces.

    Args:
        world: the world of the run.
        radius: of the feet, m.
        base: (n, 3) positions of the base, m.
        points: (n, nc, 3) contact points for the ``normals``, m: what the controller took them for.
        normals: (n, nc, 3) unit normals of the surfaces for which they were computed.
        forces: (n, nc, 3) on the feet, N.
    """
    centres = foot_centres(points, normals, radius).reshape(-1, 3)
    distances, true = world.distance(centres)
    true = true.reshape(points.shape)
    if not world.planar:
        # A force acts in the step before the tick that records it: it belongs to the foot's place at its beginning.
        before = np.concatenate((centres.reshape(points.shape)[:1], centres.reshape(points.shape)[:-1])).reshape(-1, 3)
        nearest = np.concatenate((true[:1], true[:-1])).reshape(-1, 3)
        true = _pressing_normals(world, radius, before, nearest, forces.reshape(-1, 3)).reshape(points.shape)
    height, normal = ground_below(world, base, leg_length(base, points))
    same = np.array_equal(true, normals)  # as on a level floor: no copies of the longest channels
    return {
        "contact_points": points if same else points + (radius * normals - radius * true),
        "contact_normals": normals if same else true,
        "contact_clearance": distances.reshape(points.shape[:2]) - radius,
        "ground_height": height,
        "ground_normal": normal,
    }


def friction_channel(worlds: list[tuple[int, World]], points: Array) -> Array | None:
    """Return (n, nc) the coefficients of the ground at contact points (n, nc, 3); None if all ground has one.

    Args:
        worlds: the worlds of a run with the ticks from which they hold, in order.
        points: m.
    """
    if not any(len({each.coefficient for each in world.surfaces}) > 1 for _, world in worlds):
        return None
    found = np.empty(points.shape[:2])
    for first, world in worlds:
        here = points[first:]
        found[first:] = world.friction(here[..., :2].reshape(-1, 2)).reshape(here.shape[:2])
    return found


def leg_length(base: Array, points: Array) -> float:
    """Return the median distance of contact points (n, nc, 3) from base positions (n, 3), m; 0 if there are none."""
    distances = np.linalg.norm(points - base[:, None], axis=2)
    return float(np.median(distances)) if distances.size else 0.0


def ground_below(world: World, base: Array, leg: float) -> tuple[Array, Array]:
    """Return (n,) heights, m, and (n, 3) unit normals of the ground below a robot with its base at (n, 3).

    They are those of the plane that fits the ground between the feet best; steps and blocks are smaller than the robot.
    Ground that is far below the reach of its legs does not count: a robot on stepping stones is not above the pit.

    Args:
        world: the world.
        base: m.
        leg: distance of the feet from the base, m.
    """
    at = base[:, :2]
    if world.planar or not leg > 0.0 or not len(base):
        return world.height(at), world.normal(at)
    around = _ACROSS * leg * _AROUND
    heights = world.height((at[:, None] + around).reshape(-1, 2)).reshape(len(base), -1)
    counts = heights > base[:, 2:] - _DEEPEST * leg
    counts[~counts.any(axis=1)] = True
    heights = np.where(counts, heights, 0.0)
    terms = np.column_stack([np.ones(len(around)), around])
    squares = np.einsum("nk,ki,kj->nij", counts.astype(np.float64), terms, terms)
    # Where one sample or a row of them is left, the slope that it does not tell is zero.
    squares[:, [1, 2], [1, 2]] += 1e-6 * leg**2
    plane = np.linalg.solve(squares, (heights @ terms)[..., None])[..., 0]
    normals = np.column_stack([-plane[:, 1:], np.ones(len(base))])
    return plane[:, 0], normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _pressing_normals(world: World, radius: float, centres: Array, nearest: Array, forces: Array) -> Array:
    """Return (k, 3) the normals of spheres that may touch several surfaces, from the forces (k, 3) on them."""
    contacts = world.contacts(centres, np.full(len(centres), radius), _TOUCHING)
    felt = np.linalg.norm(forces, axis=1) > _FELT_N
    normals = nearest.copy()
    for sphere in np.flatnonzero((np.bincount(contacts.sphere, minlength=len(centres)) > 1) & felt):
        begin, end = np.searchsorted(contacts.sphere, [sphere, sphere + 1])
        total = _pressing_normal(contacts.normal[begin:end], contacts.friction[begin:end], forces[sphere])
        if total is not None:
            normals[sphere] = total
    return normals


def _pressing_normal(normals: Array, friction: Array, force: Array) -> Array | None:
    """Return the (3,) unit direction of the sum of pressures along (k, 3) normals that make up a force, if any do.

    Of the many sums of forces in the friction cones of the surfaces, least squares without friction finds one. Where it
    needs more friction than there is but another does not, the direction is that for which all friction is used.
    """
    from scipy.optimize import nnls  # imported here, because it takes half a second

    shares, _ = nnls(normals.T, force)
    total: Array = shares @ normals
    size, length = float(np.linalg.norm(total)), float(np.linalg.norm(force))
    if not size > 0.0:
        return None
    total /= size
    limit, aligned = float(friction.max()), float(total @ force)
    across = force - aligned * total
    if np.linalg.norm(across) > limit * aligned:
        tangents = np.cross(normals, np.roll(normals, 1, axis=1) + [0.0, 0.0, 0.5])
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        first, second = tangents, np.cross(normals, tangents)
        around = np.cos(_FACETS)[:, None, None] * first + np.sin(_FACETS)[:, None, None] * second
        edges = (normals + friction[:, None] / math.cos(0.5 * _FACETS[1]) * around).reshape(-1, 3)
        if nnls(edges.T, force)[1] < 1e-6 * length:
            along, angle = across / np.linalg.norm(across), math.atan(0.999 * limit)
            towards = aligned * along - np.linalg.norm(across) * total  # perpendicular to the force
            total = math.cos(angle) * force / length - math.sin(angle) * towards / np.linalg.norm(towards)
    return total


def foot_centres(points: Array, normals: Array, radius: float) -> Array:
    """Return (n, nc, 3) centres of spherical feet from their contact points and the normals there, m."""
    return points + radius * normals


def along_ground(vectors: Array, normals: Array) -> Array:
    """Return (...,) the norms of the parts of (..., 3) vectors that are perpendicular to (..., 3) unit normals."""
    along = np.sum(vectors * normals, axis=-1, keepdims=True) * normals
    return np.linalg.norm(np.subtract(vectors, along, out=along), axis=-1)
