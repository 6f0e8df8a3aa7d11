"""Floor, lights, background and camera."""

import math

import numpy as np

from lgmpc.lie import quaternion
from lgmpc.runs.ground import ground_below
from lgmpc.typing import Array, IntArray
from lgmpc.viz.marks import turns_to
from lgmpc.viz.mesh import disc, shade
from lgmpc.viz.scene import Material, Scene
from lgmpc.world import Box, HeightField, Plane, World

FLOOR_COLOR = 0xE8ECF1
"""Colour of the floor and of the fog."""

BOX_COLOR, SLIPPERY_COLOR, EDGE_COLOR = 0xD3D9E0, 0xB4D3E8, 0x8D98A5
"""Colours of the ground that stands on the floor."""
_SMOOTHED = 40
"""Pictures over which the camera's height above uneven ground is averaged: about a second."""
_SLIPPERY = 0.6
"""Slippery ground has less than this share of the largest coefficient of friction."""

_FIELD_OF_VIEW_DEG = 32.0
_ASPECT = 1.6  # width over height of a typical window
_ELEVATION_DEG = 19.0
_AZIMUTHS_DEG = (38.0, -38.0, 142.0, -142.0)


def add_stage(
    scene: Scene, lowest: Array, highest: Array, travel: Array, ground: World | None = None
) -> tuple[float, float]:
    """Add floor, grid, lights and background for a robot between two corners whose base moves along ``travel``.

    Args:
        scene: the scene.
        lowest: (3,) lowest corner of the robot at the start, m.
        highest: (3,) highest corner, m.
        travel: (k, 3) base positions, m.
        ground: of the run; the level floor at height 0 unless given.

    Returns:
        Distances from the camera at which fog begins and is opaque, m.
    """
    size = float(np.linalg.norm(highest - lowest))
    middle = 0.5 * (travel.min(axis=0) + travel.max(axis=0))
    reach = 5.0 * size + float(np.ptp(travel[:, :2], axis=0).max())
    haze = [(FLOOR_COLOR >> shift & 255) / 255.0 for shift in (16, 8, 0)]
    scene.set("/Background", "top_color", haze)
    scene.set("/Background", "bottom_color", haze)
    for name in ("Grid", "Axes"):
        scene.set(f"/{name}", "visible", False)

    # Unlit, so that it is evenly bright to the horizon; a disc that shows shadows only is drawn over it.
    ground = World() if ground is None else ground
    floor = next((each for each in ground.surfaces if isinstance(each, Plane)), Plane())
    origin, below = floor.height(np.array([[0.0, 0.0], middle[:2]]))
    turn = turns_to(np.array([floor.normal_vector]))[0]
    scene.place("/floor", [0.0, 0.0, origin], turn)
    along, left, _ = quaternion.act(quaternion.inverse(turn), np.array([middle[0], middle[1], below - origin]))
    scene.add_mesh("/floor/ground", disc(4.0 * reach), Material(FLOOR_COLOR, flat=True))
    scene.place("/floor/ground", [along, left, -0.0015 * size])
    scene.add_mesh("/floor/shadow", disc(reach), Material(0x1D2733, 0.2, shadow_only=True))
    scene.place("/floor/shadow", [along, left, 0.0005 * size])
    cell = 10.0 ** math.floor(math.log10(size))
    cell = min((0.1 * cell, 0.2 * cell, 0.5 * cell, cell), key=lambda c: abs(math.log(c / (0.18 * size))))
    for name, spacing, color in (("fine", cell, 0xCBD3DC), ("coarse", 5.0 * cell, 0x9FABB8)):
        scene.add_segments(f"/floor/{name}", _grid(spacing, reach), color)
        scene.place(f"/floor/{name}", [*(spacing * np.round(np.array([along, left]) / spacing)), 0.0])

    add_solids(scene, ground, cell)

    # The replay moves the lights with the camera.
    start = travel[0]
    key, key_light = "/Lights/SpotLight", "/Lights/SpotLight/<object>"
    scene.set(key, "visible", True)
    scene.set(key_light, "position", (start + size * np.array([1.1, -1.6, 4.2])).tolist())
    for name, value in (("castShadow", True), ("intensity", 0.42), ("angle", 0.5), ("penumbra", 1.0), ("decay", 0.0)):
        scene.set(key_light, name, value)
    for name, where in (("PointLightNegativeX", [3.0, 2.5, 3.0]), ("PointLightPositiveX", [-3.0, -2.0, 2.5])):
        scene.set(f"/Lights/{name}/<object>", "position", (start + size * np.array(where)).tolist())
        scene.set(f"/Lights/{name}/<object>", "intensity", 0.13)
        scene.set(f"/Lights/{name}/<object>", "distance", 0.0)
    scene.set("/Lights/AmbientLight/<object>", "intensity", 0.45)
    scene.set("/Lights/FillLight/<object>", "intensity", 0.25)
    return 2.0 * size, 6.5 * size


def add_solids(scene: Scene, ground: World, cell: float) -> None:
    """Add boxes with their edges, one object for each colour (slippery ones are bluish), and height fields."""
    boxes = [each for each in ground.surfaces if isinstance(each, Box)]
    usual = max((each.coefficient for each in ground.surfaces), default=0.0)
    for name, color, chosen in (
        ("boxes", BOX_COLOR, [each for each in boxes if each.coefficient > _SLIPPERY * usual]),
        ("slippery", SLIPPERY_COLOR, [each for each in boxes if each.coefficient <= _SLIPPERY * usual]),
    ):
        if not chosen:
            continue
        corners = np.concatenate([each.corners for each in chosen])
        first = 8 * np.arange(len(chosen))[:, None, None]
        # Sides share no vertex with another box, and none is smoothed: their edges are right angles.
        mesh = shade(corners, (first + BOX_SIDES).reshape(-1, 3))
        scene.add_mesh(f"/ground/{name}", mesh, Material(color, shininess=0.0))
        edges = corners[(first + _EDGES).reshape(-1, 2)].reshape(-1, 3) + [0.0, 0.0, 0.002 * cell]
        scene.add_segments(f"/ground/{name} edges", edges, EDGE_COLOR)

    for i, field in enumerate(each for each in ground.surfaces if isinstance(each, HeightField)):
        mesh = shade(*field_triangles(field))
        scene.add_mesh(f"/ground/heights {i}", mesh, Material(BOX_COLOR, shininess=0.0, double_sided=True))


def field_triangles(field: HeightField) -> tuple[Array, IntArray]:
    """Return the vertices (n, 3), m, and the triangles (m, 3) of a height field."""
    rows, columns = field.heights.shape
    (x0, y0), (x1, y1) = field.corners
    x, y = np.meshgrid(np.linspace(x0, x1, columns), np.linspace(y0, y1, rows))
    first = (columns * np.arange(rows - 1)[:, None] + np.arange(columns - 1)).ravel()
    corners = np.column_stack([first, first + 1, first + columns + 1, first, first + columns + 1, first + columns])
    return np.stack([x, y, field.heights], axis=-1).reshape(-1, 3), corners.reshape(-1, 3).astype(np.int64)


BOX_SIDES = np.array(
    [(4, 5, 6), (4, 6, 7), *((a, b, b + 4) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))),
     *((a, b + 4, a + 4) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)))]
)  # fmt: skip
"""Triangles of a box without its bottom, by its corners."""
_EDGES = np.array([(4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])


def frame_camera(
    lowest: Array, highest: Array, travel: Array, impulses: Array, ground: World | None = None
) -> dict[str, object]:
    """Return a camera that looks at the robot from above one of its corners, and follows it if it leaves the picture.

    The corner is on the side from which the pushes act, so that the trunk does not hide their arrows; the front left
    one without pushes.

    Args:
        lowest: (3,) lowest corner of the robot at the start, m.
        highest: (3,) highest corner, m.
        travel: (k, 3) base positions at the pictures' times, m.
        impulses: (p, 3) of the pushes, N.s.
        ground: the level floor at height 0 unless given.

    Returns:
        The camera in the viewer's axes (y up): field of view, near and far planes, position, target, height of the
        ground below the target, the smallest ratio of width to height of the picture, and for each picture the
        displacement of position and target.
    """
    size = float(np.linalg.norm(highest - lowest))
    azimuths, elevation = np.radians(_AZIMUTHS_DEG), math.radians(_ELEVATION_DEG)
    width, height = float(np.linalg.norm((highest - lowest)[:2])), float((highest - lowest)[2])
    tangent = math.tan(math.radians(0.5 * _FIELD_OF_VIEW_DEG))
    seen_height = height * math.cos(elevation) + width * math.sin(elevation)
    # Its height is at most three quarters of the picture, its width eight tenths; its near side appears larger.
    middle = max(0.5 * seen_height / (0.75 * tangent), 0.5 * width / (0.8 * _ASPECT * tangent))
    away = middle + 0.35 * width
    corners = np.column_stack((np.cos(azimuths), np.sin(azimuths)))
    corner = corners[np.argmin(corners @ impulses[:, :2].sum(axis=0))]
    offset = away * np.array([*(math.cos(elevation) * corner), math.sin(elevation)])
    # The time line covers the lower edge: the robot is a little above the middle.
    target = 0.5 * (lowest + highest) - [0.0, 0.0, 0.16 * away * tangent]
    # Horizontally as soon as it leaves the middle; vertically only with the ground and in flight, so that the motion of
    # a gait is visible.
    rise = np.zeros_like(travel)
    rise[:, 2] = 0.0 if ground is None else _even(ground, travel, size)
    above = travel - rise
    span = np.ptp(above, axis=0)
    followed = np.array([max(span[:2]) > 0.5 * size] * 2 + [span[2] > size])
    moves = (above - above[0]) * followed + (rise - rise[0]) * followed[0] if followed.any() else np.zeros((0, 3))
    return {
        "fov": _FIELD_OF_VIEW_DEG,
        "near": 0.02 * size,
        "far": 60.0 * size,
        "position": _y_up(target + offset).tolist(),
        "target": _y_up(target).tolist(),
        "floor": float(rise[0, 2]),
        "aspect": 0.5 * width / (0.8 * tangent * middle),
        "follow": np.round(_y_up(moves), 4).tolist(),
    }


def _even(ground: World, travel: Array, size: float) -> Array:
    """Return (k,) heights of the ground below a robot of a size, m, without its steps: a camera does not jump."""
    height = ground_below(ground, travel, 0.5 * size)[0]
    if ground.planar:
        return height
    window = min(_SMOOTHED, len(height))
    padded = np.pad(height, (window // 2, (window - 1) // 2), mode="edge")
    return np.convolve(padded, np.full(window, 1.0 / window), mode="valid")


def _y_up(points: Array) -> Array:
    return np.stack((points[..., 0], points[..., 2], -points[..., 1]), axis=-1)


def _grid(spacing: float, reach: float) -> Array:
    # Short segments: some software renderers drop a line that extends behind the camera.
    count = math.ceil(reach / spacing / 4.0) * 4
    ticks = spacing * np.arange(-count, count + 1)
    knots = spacing * np.arange(-count, count + 1, 4)
    x, start = np.meshgrid(ticks, knots[:-1], indexing="ij")
    first = np.stack((x, start, 0.0 * x), axis=-1)
    along = np.stack((first, first + [0.0, 4.0 * spacing, 0.0]), axis=2).reshape(-1, 3)
    return np.concatenate((along, along[:, [1, 0, 2]]))
