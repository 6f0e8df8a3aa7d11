"""Three links rotate at zero angular momentum by the area of the loop of their joint angles.

Chapter 4.16.
"""

import casadi as ca
import numpy as np

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Row, Shape
from lgmpc.lie import so3
from lgmpc.mechanics import Connection, ThreeLink
from lgmpc.mechanics.connection import circle
from lgmpc.typing import Array

CENTER = (1.0, -1.0)
"""Centre of the loops, rad: both ends bent to one side. Around the straight shape the curvature averages to zero."""
RADII = (0.1, 0.5, 1.0, 1.5)
"""rad."""
WRIGGLES = 6
"""Number of loops."""
PERIOD = 1.0
"""Duration of a loop, s."""
STEPS, FRAMES = 4000, 40
"""Steps of a loop, and pictures of it in the scene."""


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    snake = ThreeLink([1.0, 1.5, 1.0], [0.5, 0.6, 0.5])
    connection = snake.connection()
    rows, phases = [], {}
    for radius in RADII:
        loop = circle(CENTER, radius)
        phases[radius] = float(np.degrees(connection.holonomy(loop)))
        by_area = float(np.degrees(connection.phase_by_area(loop, CENTER)))
        rows.append(Row(f"turn, loop of {radius} rad: area integral, holonomy", by_area, phases[radius], 1e-9, "deg"))
    density = -float(connection.curvature(CENTER).full()[0, 1])
    small = [float(connection.holonomy(circle(CENTER, radius))) for radius in (0.05, 0.1)]
    rows.append(Row("turn over area, small loop: the curvature", density, small[0] / (np.pi * 0.05**2), 2e-3))
    rows.append(Row("exponent of the radius in small turns", 2.0, float(np.log2(small[1] / small[0])), 0.01))

    wide = circle(CENTER, RADII[-1])
    backwards = float(np.degrees(connection.holonomy(lambda s: wide(1.0 - s))))
    rows.append(Row("turn, the largest loop backwards", -phases[RADII[-1]], backwards, 1e-9, "deg"))
    s = np.linspace(0.0, 1.0, STEPS + 1)
    theta = connection.transport(wide, STEPS)
    # The attitude at the end of a loop is that at the start of the next.
    angles = np.concatenate([[0.0], *(theta[1:] + k * theta[-1] for k in range(WRIGGLES))])
    rows.append(
        Row(f"turn after {WRIGGLES} loops", WRIGGLES * phases[RADII[-1]], float(np.degrees(angles[-1])), 1e-8, "deg")
    )
    symbol = ca.SX.sym("s")
    shapes = ca.Function("loop", [symbol], [wide(symbol)]).map(s.size)(s[None, :]).full().T
    spin, own = _angular_momentum(snake, shapes, theta, PERIOD / STEPS)
    rows.append(Row("largest angular momentum over that of one link", 0.0, float(spin.max() / own.max()), 1e-5))

    times = PERIOD * np.arange(WRIGGLES * STEPS + 1) / STEPS
    every = STEPS // FRAMES
    poses = np.concatenate((shapes[:1], *(shapes[1:] for _ in range(WRIGGLES))))[::every]
    return Outcome(
        tuple(rows),
        panels=(
            _loops(),
            Panel.over_time("Attitude over the loops", "middle link, deg", Curve("", times, np.degrees(angles))),
            _scaling(connection, density),
            _curvature(connection),
        ),
        times=times[::every],
        bodies=_scene(snake, poses, angles[::every]),
        remarks=(
            "Loops about the straight shape cause no rotation: there the curvature changes its sign.",
            "After every loop the links have the initial shape and another attitude.",
            "The rotation depends on the enclosed area, weighted by the curvature, and not on the speed.",
        ),
    )


def _angular_momentum(snake: ThreeLink, shapes: Array, theta: Array, h: float) -> tuple[Array, Array]:
    """Return (n - 1,) norms of the angular momentum of all links, and of the first, by differences of their poses."""
    centers, angles = snake.links(shapes, theta)
    middle, velocity = (centers[1:] + centers[:-1]) / 2.0, np.diff(centers, axis=0) / h
    orbital = middle[..., 0] * velocity[..., 1] - middle[..., 1] * velocity[..., 0]
    momenta = snake.masses * orbital + snake.inertias * np.diff(angles, axis=0) / h
    return np.abs(momenta.sum(axis=1)), np.abs(momenta[:, 0])


def _loops() -> Panel:
    s = np.linspace(0.0, 2.0 * np.pi, 181)
    x, y = CENTER
    curves = tuple(Curve("", x + radius * np.cos(s), y + radius * np.sin(s)) for radius in RADII)
    return Panel(
        f"Loops of shapes, {RADII[0]} to {RADII[-1]} rad", "first joint, rad", "last joint, rad", curves, equal=True
    )


def _scaling(connection: Connection, density: float) -> Panel:
    radii = np.geomspace(0.02, 2.0, 25)
    turns = np.abs([float(connection.holonomy(circle(CENTER, float(radius)), 60)) for radius in radii])
    law = abs(density) * np.pi * radii**2
    curves = (
        Curve("one loop", radii, np.degrees(turns)),
        Curve("curvature times area", radii, np.degrees(law), dashed=True),
    )
    return Panel("Turn by one loop", "radius of the loop, rad", "turn, deg", curves, log_x=True, log_y=True)


def _curvature(connection: Connection) -> Panel:
    r = np.linspace(-np.pi, np.pi, 121)
    curves = []
    for other in (0.0, 1.0, 2.0):
        points = np.stack((r, np.full(r.size, other)))
        values = connection.curvature.map(r.size)(points).full().reshape(1, r.size, 4)[0, :, 1]
        curves.append(Curve(f"last joint at {other} rad", r, values))
    return Panel("Curvature of the connection", "first joint, rad", "1/rad", tuple(curves))


def _scene(snake: ThreeLink, shapes: Array, theta: Array) -> tuple[Body, ...]:
    centers, angles = snake.links(shapes, theta)
    zero = np.zeros((len(theta), 1))
    bodies = []
    for index, (name, color) in enumerate((("ends/first", 0x54A24B), ("middle", 0x4C78A8), ("ends/last", 0x54A24B))):
        length = float(snake.lengths[index])
        positions = np.concatenate((centers[:, index], zero + 0.5), axis=1)
        turns = so3.exp(np.concatenate((zero, zero, angles[:, index, None]), axis=1))
        shape = Shape("box", (length, 0.08, 0.08), color=color)
        ends = tuple(Shape("sphere", (0.05, 0.05, 0.05), (x, 0.0, 0.0), 0x333333) for x in (-length / 2, length / 2))
        bodies.append(Body(name, (shape, *ends), positions, turns))
    return tuple(bodies)
