"""Screenshots of the replay of a pushed run, evaluated by pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
from matplotlib.image import imread
from snapshot import snapshots

from lgmpc.chromium import find_chromium
from lgmpc.errors import InputError
from lgmpc.viz import replay_page, write_page
from lgmpc.viz.mesh import box, cone, cylinder, disc, ellipsoid, funnel, mesh_of, tube
from lgmpc.viz.page import page_of, time_line
from lgmpc.viz.scene import Material, Scene
from lgmpc.viz.stage import add_stage, frame_camera

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed: apt-get install chromium"),
]

SIZE = (640, 480)
WITH_PANELS = {"width": 800, "height": 570}
BEFORE, PUSHED = 0.1, 0.46


@dataclass
class Picture:
    """A screenshot as numbers, 0 to 255."""

    rgb: np.ndarray

    @classmethod
    def of(cls, png: bytes) -> Picture:
        return cls(np.round(255.0 * imread(BytesIO(png))[:, :, :3]).astype(int))

    @property
    def robot(self) -> np.ndarray:
        """Pixels in the robot's dark greys: floor, shadow and grid are brighter, everything else has a colour."""
        return (self.rgb.max(axis=2) < 150) & (np.ptp(self.rgb, axis=2) < 45)

    @property
    def push_arrow(self) -> np.ndarray:
        """Pixels in the solid orange of the push; the cones' orange is translucent, so paler."""
        red, green, blue = np.moveaxis(self.rgb, 2, 0)
        return (red > 130) & (green < 0.55 * red) & (blue < 0.3 * red)


@pytest.fixture(scope="module")
def page(solo12, pushed_run, tmp_path_factory) -> Path:
    return write_page(replay_page(solo12, pushed_run), tmp_path_factory.mktemp("page") / "replay.html")


@pytest.fixture(scope="module")
def pictures(browser, page) -> tuple[Picture, Picture]:
    before, pushed = snapshots(browser, page, (BEFORE, PUSHED), size=SIZE, panels=False)
    return Picture.of(before), Picture.of(pushed)


def test_the_robot_fills_a_good_part_of_the_picture(pictures) -> None:
    for picture in pictures:
        assert picture.robot.mean() > 0.05
        rows, columns = np.nonzero(picture.robot)
        assert np.ptp(columns) > 0.45 * SIZE[0]
        assert np.ptp(rows) > 0.45 * SIZE[1]
        # In the middle, and with all of it inside.
        assert abs(columns.mean() / SIZE[0] - 0.5) < 0.1
        assert abs(rows.mean() / SIZE[1] - 0.5) < 0.2
        assert columns.min() > 5 and columns.max() < SIZE[0] - 5 and rows.min() > 5 and rows.max() < SIZE[1] - 5


def test_the_push_arrow_is_there_while_the_robot_is_pushed(pictures) -> None:
    before, pushed = pictures
    assert before.push_arrow.sum() == 0
    assert pushed.push_arrow.sum() > 150


def test_the_robot_has_moved_under_the_push(pictures) -> None:
    before, pushed = pictures
    moved = before.robot ^ pushed.robot
    assert moved.sum() > 0.05 * before.robot.sum()


@pytest.fixture(scope="module")
def tab(browser, page) -> Iterator[Any]:
    """The page, opened once for the tests that operate it; it makes no network request and no error."""
    asked: list[str] = []
    problems: list[str] = []
    tab = browser.new_page(viewport=WITH_PANELS)
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.goto(f"{page.as_uri()}#t={BEFORE}")
    tab.evaluate("lgmpc.ready")
    yield tab
    tab.close()
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert problems == []


SHOW_ROBOT = (
    "shown => { lgmpc.viewer.scene_tree.find(['robot']).object.visible = shown; lgmpc.viewer.set_dirty();"
    " return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done))); }"
)


def test_the_robots_pixels_vanish_with_the_robot(tab) -> None:
    tab.evaluate("lgmpc.seek", BEFORE)
    tab.evaluate("document.body.classList.add('clean')")
    robot = Picture.of(tab.screenshot()).robot.sum()
    tab.evaluate(SHOW_ROBOT, False)
    assert Picture.of(tab.screenshot()).robot.sum() < 0.1 * robot
    tab.evaluate(SHOW_ROBOT, True)
    tab.evaluate("document.body.classList.remove('clean')")


def test_the_panels_work(tab) -> None:
    tab.evaluate("lgmpc.seek", 0.2)
    assert tab.inner_text("#now") == "0.20"
    assert tab.inner_text("#name") == "solo12_pushed"
    assert tab.inner_text("#verdict").lower() == "pass"
    # Space plays and pauses; the time line seeks to where it is clicked; the push shows its size.
    tab.keyboard.press("Space")
    assert tab.evaluate("document.getElementById('play').classList.contains('playing')")
    tab.wait_for_function("Number(document.getElementById('now').textContent) > 0.25")
    tab.keyboard.press("Space")
    assert not tab.evaluate("document.getElementById('play').classList.contains('playing')")
    line = tab.locator("#timeline").bounding_box()
    tab.mouse.click(line["x"] + line["width"] * 0.4 / 1.2, line["y"] + 30)
    assert float(tab.inner_text("#now")) == pytest.approx(0.4, abs=0.02)
    assert tab.inner_text("#badge") == "push 5 N for 0.2 s"
    tab.keyboard.press("Shift+ArrowRight")
    assert float(tab.inner_text("#now")) == pytest.approx(0.6, abs=0.02)
    # Each entry of the legend hides what it names.
    hidden = "path => lgmpc.viewer.scene_tree.find(path).object.visible"
    assert tab.evaluate(hidden, ["overlay", "cones"])
    tab.get_by_text("friction cones").click()
    assert not tab.evaluate(hidden, ["overlay", "cones"])
    assert not tab.evaluate(hidden, ["overlay", "planned"])
    tab.get_by_text("planned forces").click()
    assert tab.evaluate(hidden, ["overlay", "planned"])


@pytest.mark.slow
def test_camera_and_light_follow_a_robot_that_leaves(browser, solo12, pushed_run, tmp_path) -> None:
    """Camera and key light keep their places over the robot, so that it is lit, and its shadow below it, everywhere."""
    q = pushed_run.log.q.copy()
    q[:, 0] += 3.0 * pushed_run.log.time
    walked = replace(pushed_run, log=replace(pushed_run.log, q=q))
    tab = browser.new_page(viewport={"width": 320, "height": 240})
    tab.goto(f"{write_page(replay_page(solo12, walked), tmp_path / 'walked.html').as_uri()}#t=0")
    tab.evaluate("lgmpc.ready")
    places = """time => {
      lgmpc.seek(time);
      const { viewer } = lgmpc, find = (path) => viewer.scene_tree.find(path).object;
      viewer.scene.updateMatrixWorld();
      const light = find(["Lights", "SpotLight", "<object>"]);
      const at = (matrix) => matrix.elements.slice(12, 15);
      return [viewer.camera.position.toArray(), at(light.matrixWorld), at(light.target.matrixWorld)];
    }"""
    before, after = (np.array(tab.evaluate(places, time)) for time in (0.0, 1.0))
    np.testing.assert_allclose(after - before, np.tile([3.0, 0.0, 0.0], (3, 1)), atol=0.05)
    np.testing.assert_allclose(before[2], [walked.log.q[0, 0], 0.0, -walked.log.q[0, 1]], atol=0.05)
    tab.close()


def test_a_phone_has_a_time_line_of_its_whole_width(tab) -> None:
    tab.set_viewport_size({"width": 420, "height": 800})
    line, bar, card = (tab.locator(each).bounding_box() for each in ("#timeline", "#bar", "#card"))
    assert line["width"] > 340
    for each in (bar, card):
        assert 0 <= each["x"] and each["x"] + each["width"] <= 420
    assert bar["y"] + bar["height"] <= 800
    tab.set_viewport_size(WITH_PANELS)


def test_the_viewer_builds_solids_of_their_size(browser, tmp_path) -> None:
    line = np.linspace(0.0, 0.2, 5)[:, None] * [1.0, 0.5, 0.0]
    solids = {
        "cylinder": (cylinder(0.2, -0.5, 1.0), [-0.2, -0.2, -0.5, 0.2, 0.2, 1.0]),
        "cone": (cone(0.2, -0.5, 1.0), [-0.2, -0.2, -0.5, 0.2, 0.2, 1.0]),
        "funnel": (funnel(0.2, 0.3), [-0.2, -0.2, 0.0, 0.2, 0.2, 0.3]),
        "disc": (disc(0.1), [-0.1, -0.1, 0.0, 0.1, 0.1, 0.0]),
        "ellipsoid": (ellipsoid(np.array([0.3, 0.2, 0.1])), [-0.3, -0.2, -0.1, 0.3, 0.2, 0.1]),
        "box": (box(np.array([0.3, 0.2, 0.1])), [-0.3, -0.2, -0.1, 0.3, 0.2, 0.1]),
        "capsule": (mesh_of(coal.Capsule(0.1, 0.8)), [-0.1, -0.1, -0.5, 0.1, 0.1, 0.5]),
        "tube": (tube(line, 0.01), [0.0, 0.0, 0.0, 0.2, 0.1, 0.0]),
    }
    scene, still = Scene(), np.zeros((1, 3))
    fog = add_stage(scene, -np.ones(3), np.ones(3), still)
    for name, (solid, _) in solids.items():
        scene.add_mesh(f"/overlay/{name}", solid, Material(0))
    camera = frame_camera(-np.ones(3), np.ones(3), still, np.zeros((0, 3)))
    content = {"name": "", "created": "", "verdict": "pass", "reasons": [], "facts": [], "legend": [], "pushes": []}
    content |= {"start": 0.0, "series": time_line(np.zeros(1), ()), "fog": [0, *fog], "camera": camera}
    tab = browser.new_page()
    tab.goto(f"{write_page(page_of('solids', scene, content), tmp_path / 'solids.html').as_uri()}#t=0")
    tab.evaluate("lgmpc.ready")
    measured = """name => {
      const parent = lgmpc.viewer.scene_tree.find(["overlay", name]).object, mesh = parent.children[0];
      mesh.updateMatrix();
      const size = new MeshCat.THREE.Box3().setFromBufferAttribute(
        mesh.geometry.clone().applyMatrix4(mesh.matrix).attributes.position);
      return [...size.min.toArray(), ...size.max.toArray()];
    }"""
    for name, (_, expected) in solids.items():
        np.testing.assert_allclose(tab.evaluate(measured, name), expected, atol=0.012, err_msg=name)
    tab.close()


def test_a_page_that_is_no_replay_is_refused(browser, tmp_path) -> None:
    page = tmp_path / "other.html"
    page.write_text("<!DOCTYPE html><p>hello")
    with pytest.raises(InputError, match="this is none"):
        snapshots(browser, page, (0.0,))


def test_a_damaged_page_shows_an_error(browser, page, tmp_path) -> None:
    damaged = tmp_path / "damaged.html"
    text = page.read_text(encoding="utf-8")
    middle = text.index('<script id="payload"') + 5000
    damaged.write_text(text[:middle] + text[middle + 40000 :], encoding="utf-8")
    tab = browser.new_page()
    tab.goto(damaged.as_uri())
    tab.evaluate("lgmpc.ready.catch(() => null)")
    assert tab.inner_text("#trouble")
    tab.close()
