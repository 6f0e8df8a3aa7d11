"""Data of demonstrations: predicted and measured values, curves, a scene."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.typing import Array


def largest(values: Any) -> float:
    """Return the largest absolute value."""
    return float(np.abs(values).max())


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        quantity: name of the quantity.
        predicted: by theory, or by an independent computation.
        measured: in the simulation.
        tolerance: largest difference in agreement.
        unit: of all three; empty for a plain number.
    """

    quantity: str
    predicted: float
    measured: float
    tolerance: float
    unit: str = ""

    @property
    def agrees(self) -> bool:
        """Agreement of prediction and measurement; NaN never agrees."""
        return bool(math.isfinite(self.measured) and abs(self.measured - self.predicted) <= self.tolerance)


@dataclass(frozen=True)
class Curve:
    """A line in a panel.

    Attributes:
        label: in the legend; empty for none.
        x: (n,) abscissa.
        y: (n,) ordinate.
        dashed: whether it is dashed, like predictions.
    """

    label: str
    x: Array
    y: Array
    dashed: bool = False

    @staticmethod
    def each(labels: str | tuple[str, ...], x: Array, columns: Array, dashed: bool = False) -> "tuple[Curve, ...]":
        """Return a curve for each column of (n, k), with a label each, such as "xyz"."""
        return tuple(Curve(label, x, columns[:, i], dashed) for i, label in enumerate(labels))


@dataclass(frozen=True)
class Panel:
    """Axes with curves.

    Attributes:
        title: of the panel.
        x_label: quantity and unit.
        y_label: quantity and unit.
        curves: the lines.
        log_x: logarithmic abscissa.
        log_y: logarithmic ordinate.
        equal: the same scale on both axes.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False
    equal: bool = False

    @classmethod
    def over_time(cls, title: str, y_label: str, *curves: Curve, log_y: bool = False) -> "Panel":
        """Return axes over the time, s."""
        return cls(title, "time, s", y_label, curves, log_y=log_y)


@dataclass(frozen=True)
class Shape:
    """A solid.

    Attributes:
        kind: "box" (size: edges), "ellipsoid" (size: semi-axes), "sphere" (size: radius, repeated), "cylinder" (size:
            radius, radius, length; axis z) or "cone" (the same; the tip at +z).
        size: three lengths, m.
        position: of its centre in the body, m.
        color: 0xRRGGBB.
        opacity: 0 to 1.
        rotation: (3, 3) body from shape; the identity if none.
    """

    kind: str
    size: tuple[float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    color: int = 0x4C78A8
    opacity: float = 1.0
    rotation: Array | None = None


@dataclass(frozen=True)
class Body:
    """A moving rigid body of the scene.

    Attributes:
        name: unique in the scene; bodies with the same part before a slash share an entry of the legend.
        shapes: its geometry in the scene.
        positions: (n, 3) world, m.
        rotations: (n, 3, 3) world from body.
    """

    name: str
    shapes: tuple[Shape, ...]
    positions: Array
    rotations: Array


@dataclass(frozen=True)
class Path:
    """A fixed line in space.

    Attributes:
        name: unique in the scene.
        points: (n, 3) world, m.
        color: 0xRRGGBB.
    """

    name: str
    points: Array
    color: int = 0xE45756


@dataclass(frozen=True)
class Outcome:
    """The results of a demonstration.

    Attributes:
        rows: the table; the demonstration succeeds if all agree.
        panels: the figure.
        times: (n,) times of the scene's poses, s; as long as every body's.
        bodies: moving bodies of the scene.
        paths: lines of the scene.
        remarks: a sentence each.
        floor: whether the ground, z = 0, is part of the scene; else the scene is drawn above one.
    """

    rows: tuple[Row, ...]
    panels: tuple[Panel, ...] = ()
    times: Array | None = None
    bodies: tuple[Body, ...] = ()
    paths: tuple[Path, ...] = ()
    remarks: tuple[str, ...] = ()
    floor: bool = False

    @property
    def agrees(self) -> bool:
        """Agreement of all predictions."""
        return all(row.agrees for row in self.rows)


@dataclass(frozen=True)
class Demo:
    """A demonstration.

    Attributes:
        name: as on the command line.
        summary: one line.
        run: computes the outcome in a few seconds.
    """

    name: str
    summary: str
    run: Callable[[], Outcome]
