"""Featherstone's spatial vectors and the geometry of SE(3): table 4.9.1 of the chapter, evaluated on both sides.

Spatial vectors are those of Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 2: angular first, and the
transform X from frame A to frame B consists of E = R^T and r of the placement of B in A. In lgmpc and Pinocchio linear
parts are first; :func:`swap` converts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.mechanics.checks import check_inertia, check_positive, check_vector
from lgmpc.mechanics.multibody.articulated import ArticulatedBody
from lgmpc.mechanics.reduction.groups import SE3
from lgmpc.typing import Array

__all__ = [
    "Correspondence",
    "correspondences",
    "force_cross",
    "force_transform",
    "motion_cross",
    "motion_transform",
    "spatial_inertia",
    "static_torques",
    "swap",
]

_SWAP = np.roll(np.eye(6), 3, axis=0)


@dataclass(frozen=True)
class Correspondence:
    """One line of the table.

    Attributes:
        featherstone: name on the left.
        geometry: name on the right.
        left: (6, 6) or (6,) by Featherstone's formula, converted to linear first.
        right: the same by the Lie group's.
    """

    featherstone: str
    geometry: str
    left: Array
    right: Array

    @property
    def error(self) -> float:
        """Largest difference between the two."""
        return float(np.abs(self.left - self.right).max())


def swap(value: ArrayLike) -> Array:
    """Convert a spatial vector (6,) or matrix (6, 6) from angular first to linear first, or back.

    Raises:
        InputError: another shape.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape == (6,):
        vector: Array = _SWAP @ array
        return vector
    if array.shape == (6, 6):
        matrix: Array = _SWAP @ array @ _SWAP.T
        return matrix
    raise InputError("value", f"shape {array.shape}", "shape (6,) or (6, 6)")


def motion_transform(placement: ArrayLike) -> Array:
    """Return (6, 6) X: motion vectors from the outer frame to the placed one, angular first (eq. 2.24).

    Raises:
        InputError: no placement (4, 4).
    """
    pose = SE3.check_element("placement", placement)
    turn, r = pose[:3, :3].T, so3.hat(pose[:3, 3])
    return np.block([[turn, np.zeros((3, 3))], [-turn @ r, turn]])


def force_transform(placement: ArrayLike) -> Array:
    """Return (6, 6) X* = X^-T: force vectors from the outer frame to the placed one, angular first (eq. 2.25).

    Raises:
        InputError: no placement (4, 4).
    """
    pose = SE3.check_element("placement", placement)
    turn, r = pose[:3, :3].T, so3.hat(pose[:3, 3])
    return np.block([[turn, -turn @ r], [np.zeros((3, 3)), turn]])


def motion_cross(v: ArrayLike) -> Array:
    """Return (6, 6) v x on motions, angular first (eq. 2.31).

    Raises:
        InputError: ``v`` is not (6,), or not finite.
    """
    omega, linear = (so3.hat(part) for part in np.split(check_vector("v", v, 6), 2))
    return np.block([[omega, np.zeros((3, 3))], [linear, omega]])


def force_cross(v: ArrayLike) -> Array:
    """Return (6, 6) v x* on forces, angular first (eq. 2.32).

    Raises:
        InputError: ``v`` is not (6,), or not finite.
    """
    omega, linear = (so3.hat(part) for part in np.split(check_vector("v", v, 6), 2))
    return np.block([[omega, linear], [np.zeros((3, 3)), omega]])


def spatial_inertia(mass: float, com: ArrayLike, inertia: ArrayLike) -> Array:
    """Return (6, 6) the inertia about a frame's origin, angular first (eq. 2.63).

    Args:
        mass: kg.
        com: (3,) centre of mass in the frame, m.
        inertia: (3, 3) rotational inertia about the centre of mass, kg.m2.

    Raises:
        InputError: mass not positive, a centre of another shape, or an inertia that no body has.
    """
    check_positive("mass", mass, "kg")
    moment = check_inertia("inertia", inertia)
    c = so3.hat(check_vector("com", com, 3))
    return np.block([[moment + mass * c @ c.T, mass * c], [mass * c.T, mass * np.eye(3)]])


def correspondences(
    placement: ArrayLike, xi: ArrayLike, mass: float, com: ArrayLike, inertia: ArrayLike
) -> tuple[Correspondence, ...]:
    """Evaluate table 4.9.1 on both sides, for one placement, one twist and one body.

    Args:
        placement: (4, 4) of a frame B in a frame A.
        xi: (6,) twist of the body in its own frame, linear first.
        mass: kg.
        com: (3,) in the body's frame, m.
        inertia: (3, 3) about the centre of mass, kg.m2.

    Raises:
        InputError: no placement, no twist, or no inertia.
    """
    pose, twist = SE3.check_element("placement", placement), check_vector("xi", xi, 6)
    back = se3.inverse(pose)
    body = spatial_inertia(mass, com, inertia)
    # The kinetic energy's quadratic form, from the velocity of the centre of mass, without spatial algebra.
    to_com = np.hstack([np.eye(3), -so3.hat(np.asarray(com, dtype=np.float64))])
    turning = np.hstack([np.zeros((3, 3)), np.eye(3)])
    energy = mass * to_com.T @ to_com + turning.T @ np.asarray(inertia) @ turning
    v = swap(twist)
    return (
        Correspondence("Plucker transform X", "Ad(T^-1)", swap(motion_transform(pose)), se3.adjoint(back)),
        Correspondence("force transform X*", "Ad(T)^T", swap(force_transform(pose)), se3.adjoint(pose).T),
        Correspondence("motion cross v x", "ad(xi)", swap(motion_cross(v)), se3.ad(twist)),
        Correspondence("force cross v x*", "-ad(xi)^T", swap(force_cross(v)), -se3.coadjoint(twist)),
        Correspondence("spatial inertia I", "kinetic-energy metric", swap(body), energy),
        Correspondence(
            "bias v x* (I v)", "-ad*_xi (G xi)", swap(force_cross(v) @ body @ v), -se3.coadjoint(twist) @ energy @ twist
        ),
    )


def static_torques(body: ArticulatedBody, joints: ArrayLike, link: int, wrench: ArrayLike) -> Array:
    """Return (n,) the load ``J^T f`` of every joint under a wrench on a link (exercise H.1).

    The load of a joint is the component of the wrench along its axis; on its parent the wrench is ``Ad(T^-1)^T f``: the
    backward pass of RNEA, at rest and without gravity.

    Args:
        body: the tree.
        joints: (n,) joint positions, rad (m).
        link: index of the link on which the wrench acts.
        wrench: (6,) [force; moment] at the link's joint frame, its axes, N and N.m.

    Raises:
        InputError: no such link, or arrays of wrong shape.
    """
    positions, f = check_vector("joints", joints, len(body.links)), check_vector("wrench", wrench, 6)
    if not 0 <= link < len(body.links):
        raise InputError("link", link, f"0 to {len(body.links) - 1}")
    torques = np.zeros(len(body.links))
    while link >= 0:
        each = body.links[link]
        torques[link] = each.twist @ f
        step = np.array(each.moved(float(positions[link])))
        f = se3.adjoint(se3.inverse(step)).T @ f
        link = each.parent
    return torques
