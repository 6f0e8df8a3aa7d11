"""Figure and page of a demonstration that is made up here: a ball on a circle."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from matplotlib.image import imread

from lgmpc.demos.outcome import Body, Curve, Demo, Outcome, Panel, Path, Row, Shape
from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.viz.demonstration import demo_page, draw_demo

from .test_replay import content_of

TIMES = np.linspace(0.0, 2.0, 81)


def circling(**changes) -> Outcome:
    angle = np.pi * TIMES
    positions = np.column_stack((np.cos(angle), np.sin(angle), -0.5 * np.ones_like(angle)))
    rotations = so3.exp(np.column_stack((0.0 * angle, 0.0 * angle, 2.0 * angle)))
    shapes = (Shape("ellipsoid", (0.3, 0.2, 0.1)), Shape("box", (0.1, 0.1, 0.4), (0.0, 0.0, 0.3), 0xE45756))
    content = {
        "rows": (Row("radius", 1.0, float(np.linalg.norm(positions[7, :2])), 1e-12, "m"),),
        "panels": (
            Panel("Height", "time, s", "m", (Curve("", TIMES, positions[:, 2]),)),
            Panel("Path", "x, m", "y, m", (Curve("predicted", *positions.T[:2], dashed=True),), equal=True),
        ),
        "times": TIMES,
        "bodies": (Body("ball", shapes, positions, rotations),),
        "paths": (Path("circle", positions),),
        "remarks": ("It goes round.",),
    }
    return Outcome(**(content | changes))


DEMO = Demo("circle", "a ball goes round", circling)


def test_the_figure_has_a_panel_for_each(tmp_path) -> None:
    picture = imread(draw_demo(DEMO, circling(), tmp_path / "figure.png"))
    assert picture.shape[1] > 1.5 * picture.shape[0]
    assert (np.ptp(picture[:, :, :3], axis=2) > 0.4).any(), "no coloured curve"


def test_nothing_to_draw_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="something to draw"):
        draw_demo(DEMO, circling(panels=()), tmp_path / "figure.png")
    with pytest.raises(InputError, match="a scene"):
        demo_page(DEMO, circling(bodies=()))
    odd = Body("odd", (Shape("elipsoid", (1.0, 1.0, 1.0)),), np.zeros((81, 3)), np.tile(np.eye(3), (81, 1, 1)))
    with pytest.raises(InputError, match="Did you mean ellipsoid"):
        demo_page(DEMO, circling(bodies=(odd,)))


def test_the_page_contains_rows_remarks_and_agreement(tmp_path) -> None:
    content = content_of(demo_page(DEMO, circling()))
    assert content["name"] == "circle"
    assert content["verdict"] == "pass"
    assert content["facts"][0] == ["predictions met", "1 of 1"]
    assert [entry["label"] for entry in content["legend"]] == ["ball", "circle"]
    assert content["reasons"] == ["It goes round."]
    assert content["duration"] == pytest.approx(2.0)
    broken = circling(rows=(Row("radius", 1.0, float("nan"), 1e-12, "m"),))
    content = content_of(demo_page(DEMO, broken))
    assert content["verdict"] == "fail"
    assert content["facts"] == [["predictions met", "0 of 1"]]


def test_bodies_of_one_group_share_an_entry_of_the_legend() -> None:
    (ball,) = circling().bodies
    names = ("ring", "balls/1", "balls/2", "balls/3")
    many = tuple(dataclasses.replace(ball, name=name) for name in names)
    entries = content_of(demo_page(DEMO, circling(bodies=many)))["legend"]
    assert [(entry["label"], entry["path"]) for entry in entries] == [
        ("ring", "/bodies/ring"),
        ("balls", "/bodies/balls"),
        ("circle", "/paths/circle"),
    ]


def test_what_stands_on_the_floor_is_not_lifted() -> None:
    def height(outcome: Outcome) -> float:
        commands = content_of(demo_page(DEMO, outcome))["commands"]
        (place,) = [c["value"] for c in commands if c.get("path") == "/bodies/ball" and c["property"] == "position"]
        return place[2]

    (ball,) = circling().bodies
    standing = dataclasses.replace(ball, positions=ball.positions + [0.0, 0.0, 0.6])
    assert height(circling(bodies=(standing,), paths=(), floor=True)) == pytest.approx(0.1)
    assert height(circling(bodies=(standing,), paths=())) > 0.1


def test_nothing_hangs_below_the_floor() -> None:
    content = content_of(demo_page(DEMO, circling()))
    (place,) = [
        c["value"] for c in content["commands"] if c.get("path") == "/bodies/ball" and c["property"] == "position"
    ]
    # The lowest point is 0.1 m (the ellipsoid's semi-axis) below the body.
    assert place[2] > 0.1
