from __future__ import annotations

import gzip
import json
from typing import Any

import numpy as np
import pytest

from lgmpc.viz.mesh import cylinder, shade
from lgmpc.viz.scene import Material, Scene

from .test_mesh import SIDES, TRIANGLES

TYPES = {"Float32Array": "<f4", "Int16Array": "<i2", "Uint16Array": "<u2", "Uint32Array": "<u4"}


BOX = shade(SIDES, TRIANGLES)


def unpack(packed: bytes) -> dict[str, Any]:
    """Read a payload as the page does."""
    data = gzip.decompress(packed)
    length = int.from_bytes(data[:8], "little")

    def resolve(value: Any) -> Any:
        if isinstance(value, dict) and "$array" in value:
            kind, offset, count = value["$array"]
            assert (8 + length + offset) % np.dtype(TYPES[kind]).itemsize == 0, (
                "typed arrays of JavaScript must be aligned"
            )
            return np.frombuffer(data, TYPES[kind], count, 8 + length + offset)
        if isinstance(value, dict):
            return {key: resolve(item) for key, item in value.items()}
        return [resolve(item) for item in value] if isinstance(value, list) else value

    return resolve(json.loads(data[8 : 8 + length]))


def tracks(content: dict[str, Any], path: str) -> dict[str, Any]:
    (clip,) = [animation["clip"] for animation in content["animations"] if animation["path"] == path]
    return {track["name"]: track for track in clip["tracks"]}


def test_a_mesh_is_unpacked_unchanged() -> None:
    scene, mesh = Scene(), BOX
    scene.add_mesh("/a", mesh, Material(0x112233, opacity=0.5))
    (command,) = unpack(scene.pack({}))["commands"]
    assert command["path"] == "/a"
    data = command["object"]["geometries"][0]["data"]
    np.testing.assert_array_equal(data["attributes"]["position"]["array"], mesh.positions.ravel())
    normals = data["attributes"]["normal"]["array"] / 32767.0
    np.testing.assert_allclose(normals, mesh.normals.ravel(), atol=2e-5)
    np.testing.assert_array_equal(data["index"]["array"], mesh.faces.ravel())
    material = command["object"]["materials"][0]
    assert material["color"] == 0x112233
    assert material["transparent"] and material["depthTest"]
    assert command["object"]["object"]["material"] == material["uuid"]


def test_a_mesh_that_is_used_often_is_stored_once() -> None:
    sizes = []
    for mesh, copies in ((BOX, 1), (BOX, 20), (cylinder(0.1, 0.0, 0.4), 1), (cylinder(0.1, 0.0, 0.4), 20)):
        scene = Scene()
        for k in range(copies):
            scene.add_mesh(f"/{k}", mesh, Material(0))
        sizes.append(len(scene._bytes))
    assert sizes[0] == sizes[1] and sizes[2] == sizes[3]


def test_what_does_not_move_has_no_track() -> None:
    scene, times = Scene(), np.linspace(0.0, 1.0, 11)
    scene.animate("/still", times, position=np.tile([1.0, 2.0, 3.0], (11, 1)), visible=np.ones(11, dtype=bool))
    content = unpack(scene.pack({}))
    assert content["animations"] == []
    assert {c["property"]: c["value"] for c in content["commands"]} == {
        "position": pytest.approx([1.0, 2.0, 3.0]),
        "visible": True,
    }


def test_keys_that_are_left_out_are_interpolated_back() -> None:
    times = np.linspace(0.0, 2.0, 201)
    position = np.zeros((201, 3))
    position[50:80, 1] = 0.1 * np.sin(np.linspace(0.0, np.pi, 30))
    scene = Scene()
    scene.animate("/a", times, position=position)
    content = unpack(scene.pack({}))
    track = tracks(content, "/a")[".position"]
    assert len(track["times"]) < 40
    values = track["values"].reshape(-1, 3)
    for axis in range(3):
        back = np.interp(times, track["times"], values[:, axis])
        np.testing.assert_allclose(back, position[:, axis], atol=1.1e-5)
    assert content["duration"] == 2.0


def test_the_signs_of_quaternions_make_no_jump() -> None:
    times, angle = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 3.0, 21)
    turns = np.stack([np.sin(angle), 0.0 * angle, 0.0 * angle, np.cos(angle)], axis=1)
    given = turns * np.where(np.arange(21) % 3 == 1, -1.0, 1.0)[:, None]
    scene = Scene()
    scene.animate("/a", times, quaternion=given)
    track = tracks(unpack(scene.pack({})), "/a")[".quaternion"]
    keys = np.searchsorted(times, track["times"] - 1e-6)
    np.testing.assert_allclose(track["values"].reshape(-1, 4), turns[keys], atol=1e-4)


def test_every_clip_lasts_as_long_as_the_longest() -> None:
    """The viewer loops each clip on its own: clips of different lengths would drift apart."""
    scene = Scene()
    scene.animate("/a", np.array([0.0, 1.0]), position=np.array([[0.0, 0, 0], [1, 0, 0]]))
    scene.animate("/b", np.array([0.0, 3.0]), scale=np.array([[1.0, 1, 1], [2, 1, 1]]))
    clips = [animation["clip"]["duration"] for animation in unpack(scene.pack({}))["animations"]]
    assert clips == [3.0, 3.0]


def test_visibility_has_keys_at_its_changes() -> None:
    scene, times = Scene(), np.arange(6.0)
    scene.animate("/a", times, visible=np.array([False, False, True, True, False, False]))
    track = tracks(unpack(scene.pack({})), "/a")[".visible"]
    assert track["times"] == [0.0, 2.0, 4.0]
    assert track["values"] == [False, True, False]


def test_the_same_scene_is_the_same_bytes() -> None:
    def build() -> bytes:
        scene = Scene()
        scene.add_mesh("/a", BOX, Material(1))
        scene.add_segments("/b", np.zeros((4, 3)), 2)
        return scene.pack({"x": [1, 2]})

    assert build() == build()
    assert unpack(build())["x"] == [1, 2]
