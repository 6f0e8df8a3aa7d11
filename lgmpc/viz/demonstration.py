"""Figure and page of a demonstration."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lgmpc.demos.outcome import Body, Demo, Outcome, Panel, Row, Shape
from lgmpc.errors import InputError
from lgmpc.lie import quaternion
from lgmpc.runs import atomic_write
from lgmpc.typing import Array
from lgmpc.viz.figure_files import INK, PALETTE, SOFT, figure_maker
from lgmpc.viz.mesh import Mesh, box, cone, cylinder, ellipsoid
from lgmpc.viz.page import page_of, time_line
from lgmpc.viz.scene import Material, Scene
from lgmpc.viz.stage import FLOOR_COLOR, add_stage, frame_camera

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

_LONG_LEGEND = 4
"""Largest number of legend entries inside the axes; longer legends are beside them."""

_FEW_DECADES = 1.5
"""Logarithmic axes of fewer decades have labels between the powers of ten."""

_CLEARANCE = 0.12
"""Height above the floor of a scene without one, as a fraction of its size."""


def draw_demo(demo: Demo, outcome: Outcome, file: Path | str) -> Path:
    """Draw the panels of a demonstration into one PNG file.

    Raises:
        InputError: nothing to draw.
        RunFolderError: the file cannot be written.
        MissingDependencyError: matplotlib is not installed.
    """
    path = Path(file)
    if not outcome.panels:
        raise InputError("outcome", "no panel", "something to draw")
    columns = min(len(outcome.panels), 3 if len(outcome.panels) != 4 else 2)
    rows = math.ceil(len(outcome.panels) / columns)
    with figure_maker("the figure of a demonstration") as make:
        figure = make()
        figure.set_size_inches(4.6 * columns + 0.4, 3.6 * rows + 0.4)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, panel in zip(grid.flat, outcome.panels, strict=False):
            _draw_panel(axes, panel)
        for axes in grid.flat[len(outcome.panels) :]:
            axes.set_axis_off()
        figure.suptitle(f"{demo.name} · {demo.summary}", x=0.01, ha="left", fontsize=9, color=SOFT)
        with atomic_write(path) as stream:
            figure.savefig(stream, format="png")
    return path


def _draw_panel(axes: "Axes", panel: Panel) -> None:
    # Predictions are drawn dark over the measurements' colours.
    colors = iter(PALETTE * (len(panel.curves) // len(PALETTE) + 1))
    for curve in sorted(panel.curves, key=lambda each: each.dashed):
        look: dict[str, Any] = {"color": INK if curve.dashed else next(colors), "label": curve.label or None}
        if curve.dashed:
            look |= {"ls": "--", "lw": 1.1, "zorder": 3.0}
        axes.plot(curve.x, curve.y, **look)
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    axes.set_xscale("log" if panel.log_x else "linear")
    axes.set_yscale("log" if panel.log_y else "linear")
    for axis, logarithmic in ((axes.xaxis, panel.log_x), (axes.yaxis, panel.log_y)):
        if logarithmic:
            _label_decades(axis)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    count = sum(bool(curve.label) for curve in panel.curves)
    if count > _LONG_LEGEND:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
    elif count:
        axes.legend(loc="best", frameon=True, framealpha=0.85, edgecolor="none")


def _label_decades(axis: "Axis") -> None:
    """Label a logarithmic axis at powers of ten, and between them if there are few."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    low, high = axis.get_view_interval()
    if math.log10(high / low) < _FEW_DECADES:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def demo_page(demo: Demo, outcome: Outcome) -> str:
    """Return the page that plays the scene of a demonstration.

    Raises:
        InputError: there is no scene.
        MissingDependencyError: meshcat is not installed.
    """
    if outcome.times is None or not outcome.bodies:
        raise InputError("outcome", "no moving body", "a scene")
    lowest, highest = _extent(outcome)
    clearance = 0.0 if outcome.floor else _CLEARANCE * float(np.linalg.norm(highest - lowest))
    lift = np.array([0.0, 0.0, 0.0 if outcome.floor else max(clearance - lowest[2], 0.0)])
    lowest, highest = lowest + lift, highest + lift
    scene = Scene()
    middle = 0.5 * (lowest + highest)[None, :]
    fog = add_stage(scene, lowest, highest, middle)
    for body in outcome.bodies:
        _add_body(scene, body, outcome.times, lift)
    for path in outcome.paths:
        line = np.repeat(path.points + lift, 2, axis=0)[1:-1]
        scene.add_segments(f"/paths/{path.name}", line, path.color)
    content = {
        "name": demo.name,
        "created": demo.summary,
        "verdict": "pass" if outcome.agrees else "fail",
        "reasons": list(outcome.remarks),
        "facts": _facts(outcome.rows),
        "legend": _legend(outcome),
        "pushes": [],
        "start": float(outcome.times[0]),
        "series": time_line(outcome.times - outcome.times[0], ()),
        "fog": [FLOOR_COLOR, *fog],
        "camera": frame_camera(lowest, highest, middle, np.zeros((0, 3))),
    }
    return page_of(f"{demo.name} · lgmpc demo", scene, content)


def _facts(rows: tuple[Row, ...]) -> list[tuple[str, str]]:
    """Return the card's facts: the number of predictions met, and the largest deviation."""
    shares = [abs(row.measured - row.predicted) / row.tolerance for row in rows if row.tolerance > 0]
    facts = [("predictions met", f"{sum(row.agrees for row in rows)} of {len(rows)}")]
    if shares and np.isfinite(shares).all():
        facts.append(("farthest off", f"{100.0 * max(shares):.2g} % of tolerance"))
    return facts


def _legend(outcome: Outcome) -> list[dict[str, object]]:
    """Return a legend entry for each body or group of bodies, in the first one's colour, and for each path."""
    colors: dict[str, int] = {}
    for body in outcome.bodies:
        colors.setdefault(body.name.split("/")[0], body.shapes[0].color)
    entries = [(f"/bodies/{name}", name, color) for name, color in colors.items()]
    entries += [(f"/paths/{path.name}", path.name, path.color) for path in outcome.paths]
    return [
        {"path": path, "label": label, "note": "", "color": f"#{color:06x}", "on": True}
        for path, label, color in entries
    ]


def _add_body(scene: Scene, body: Body, times: Array, lift: Array) -> None:
    path = f"/bodies/{body.name}"
    for i, shape in enumerate(body.shapes):
        part = f"{path}/{i}"
        scene.add_mesh(part, _mesh(shape), Material(shape.color, shape.opacity))
        turn = quaternion.identity() if shape.rotation is None else quaternion.from_matrix(shape.rotation)
        scene.place(part, shape.position, turn)
    turns = quaternion.from_matrix(body.rotations)
    scene.animate(path, times - times[0], position=body.positions + lift, quaternion=turns)


def _mesh(shape: Shape) -> Mesh:
    size = np.asarray(shape.size, dtype=np.float64)
    if shape.kind == "box":
        return box(0.5 * size)
    if shape.kind in ("ellipsoid", "sphere"):
        return ellipsoid(size)
    if shape.kind in ("cylinder", "cone"):
        return (cylinder if shape.kind == "cylinder" else cone)(size[0], -0.5 * size[2], 0.5 * size[2])
    raise InputError("kind", shape.kind, "a kind of shape", ("box", "ellipsoid", "sphere", "cylinder", "cone"))


def _extent(outcome: Outcome) -> tuple[Array, Array]:
    """Return the lowest and highest corner (3,) of the whole scene over time, m."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for body in outcome.bodies:
        for shape in body.shapes:
            middle = body.positions + body.rotations @ np.asarray(shape.position)
            own = np.asarray(shape.size) * (0.5 if shape.kind == "box" else 1.0)
            if shape.kind in ("cylinder", "cone"):
                own = own * [1.0, 1.0, 0.5]
            turns = body.rotations if shape.rotation is None else body.rotations @ shape.rotation
            # Half extents of the box around the rotated shape.
            reach = np.abs(turns) @ own
            low, high = np.minimum(low, (middle - reach).min(axis=0)), np.maximum(high, (middle + reach).max(axis=0))
    for path in outcome.paths:
        low, high = np.minimum(low, path.points.min(axis=0)), np.maximum(high, path.points.max(axis=0))
    return low, high
