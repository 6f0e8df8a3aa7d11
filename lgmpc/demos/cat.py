"""A falling cat turns over at zero angular momentum (chapter 4.16)."""

import casadi as ca
import numpy as np

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Row, Shape, largest
from lgmpc.lie import so3
from lgmpc.mechanics.phases import Cat, flip
from lgmpc.typing import GRAVITY, Array

FALL = 0.7
"""Duration of the fall, s."""
STEPS = 6000
FRAMES = 150

# The cat's frame in the world at the start: spine (z) along x, feet (x) up.
BACK_DOWN = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotates a cylinder's axis, z, to x."""


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    cat = Cat()
    connection = cat.connection()
    bend = cat.flipping_bend()
    loop = flip(bend)
    attitudes = BACK_DOWN @ connection.transport(loop, STEPS)
    s = np.linspace(0.0, 1.0, STEPS + 1)
    times = FALL * s
    symbol = ca.SX.sym("s")
    shapes = ca.Function("loop", [symbol], [loop(symbol)]).map(s.size)(s[None, :]).full().T
    halves = cat.halves(shapes, attitudes)

    turned = np.unwrap(np.arctan2(*(BACK_DOWN.T @ attitudes)[:, [1, 0], 0].T))
    spin, own = _angular_momentum(cat, halves, FALL / STEPS)
    back = so3.log(BACK_DOWN.T @ attitudes[-1])
    half_way = cat.turn(bend / 2.0)
    rows = [
        Row("turn about the spine", 180.0, float(np.degrees(np.linalg.norm(back))), 1e-9, "deg"),
        Row("turn about any other axis", 0.0, float(np.degrees(np.linalg.norm(back[:2]))), 1e-9, "deg"),
        Row(
            "turn with half the bend, by the closed form",
            float(np.degrees(half_way)),
            float(np.degrees(so3.log(connection.holonomy(flip(bend / 2.0), 300))[2])),
            1e-9,
            "deg",
        ),
        Row("shape at the end less shape at the start", 0.0, largest(shapes[-1] - shapes[0]), 1e-12, "rad"),
        # Differences of poses give the velocities to second order in the interval.
        Row("largest angular momentum over that of the front half", 0.0, float(spin.max() / own.max()), 1e-5),
    ]
    return Outcome(
        tuple(rows),
        panels=(
            Panel("Shape: bend of the spine", "r_x, rad", "r_y, rad", (Curve("", *shapes.T),), equal=True),
            Panel.over_time("Attitude", "turn about the spine, deg", Curve("", times, np.degrees(turned))),
            Panel.over_time(
                "Angular momentum",
                "N.m.s",
                Curve("front half", times[1:], own),
                Curve("whole cat", times[1:], spin, dashed=True),
            ),
            _turns(cat, bend),
        ),
        times=times[:: STEPS // FRAMES],
        bodies=_scene(halves),
        remarks=(
            f"The spine bends by {np.degrees(bend):.1f} deg, the bend turns once about it, and the spine straightens.",
            "The shape is the initial one and the cat is upside down: a holonomy at zero angular momentum.",
            f"It falls {0.5 * GRAVITY * FALL**2:.2f} m meanwhile; the scene's frame falls with it.",
        ),
    )


def _angular_momentum(cat: Cat, halves: tuple[tuple[Array, Array], ...], h: float) -> tuple[Array, Array]:
    """Return (n - 1,) norms of the angular momentum about the centre of mass, of both halves and of the front one."""
    inertia = np.array([cat.transverse, cat.transverse, cat.axial])
    momenta = []
    for position, rotation in halves:
        turn = so3.log(np.swapaxes(rotation[:-1], 1, 2) @ rotation[1:])
        middle = rotation[:-1] @ so3.exp(turn / 2.0)
        own = np.einsum("nij,nj->ni", middle, inertia * turn / h)
        orbital = cat.mass * np.cross((position[1:] + position[:-1]) / 2.0, (position[1:] - position[:-1]) / h)
        momenta.append(own + orbital)
    return np.linalg.norm(momenta[0] + momenta[1], axis=1), np.linalg.norm(momenta[0], axis=1)


def _turns(cat: Cat, bend: float) -> Panel:
    bends = np.linspace(0.0, np.radians(150.0), 100)
    turns = np.array([-np.degrees(cat.turn(size)) for size in bends])
    curves = (
        Curve("closed form", np.degrees(bends), turns),
        Curve("this cat", np.degrees([bend, bend]), np.array([0.0, 180.0]), dashed=True),
    )
    return Panel("Rotation by a circuit of the bend", "bend, deg", "turn, deg", curves)


def _scene(halves: tuple[tuple[Array, Array], ...]) -> tuple[Body, ...]:
    """Return the halves in a frame that falls with them."""
    every = STEPS // FRAMES
    return tuple(
        Body(name, _half(side), position[::every], rotation[::every])
        for name, side, (position, rotation) in (("front", 1.0, halves[0]), ("rear", -1.0, halves[1]))
    )


def _half(side: float) -> tuple[Shape, ...]:
    fur, paws = 0xD08B3E, 0xF4E4C9
    legs = tuple(
        Shape("cylinder", (0.015, 0.015, 0.12), (0.09, y, side * 0.04), paws, rotation=ALONG_X) for y in (-0.04, 0.04)
    )
    torso = Shape("ellipsoid", (0.06, 0.06, 0.13), (0.0, 0.0, 0.0), fur)
    if side < 0.0:
        return (torso, *legs, Shape("cylinder", (0.012, 0.012, 0.2), (0.0, 0.0, -0.2), fur))
    ears = tuple(
        Shape("cone", (0.015, 0.015, 0.04), (-0.05, y, 0.16), fur, rotation=-ALONG_X @ np.diag([1.0, -1.0, 1.0]))
        for y in (-0.03, 0.03)
    )
    return (torso, *legs, Shape("sphere", (0.055, 0.055, 0.055), (-0.01, 0.0, 0.16), fur), *ears)
