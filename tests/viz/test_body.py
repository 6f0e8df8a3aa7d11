from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import ModelSource, RobotSpec, load_robot
from lgmpc.viz.body import _is_misread, load_body
from lgmpc.viz.scene import Scene

from .test_scene import tracks, unpack


def test_solo12_has_its_meshes_and_its_size(solo12) -> None:
    body = load_body(solo12)
    assert len(body.parts) == 17
    assert len({id(part.mesh) for part in body.parts}) == 10  # legs share theirs
    lowest, highest = body.bounds(solo12.q_reference)
    assert abs(lowest[2]) < 0.005  # the feet stand on the floor
    assert 0.2 < highest[2] < 0.35
    assert 0.3 < highest[0] - lowest[0] < 0.7


@pytest.mark.parametrize("model", ["go2", "anymal_c"])
def test_parts_of_several_materials_are_drawn_whole(model: str) -> None:
    """Every vertex of the URDF's visuals belongs to a drawn triangle: the drawn part is as large as the file."""
    robot = load_robot(RobotSpec(model=model))
    folders = [str(folder) for folder in robot.source.package_dirs]
    visuals = pin.buildGeomFromUrdf(
        robot.model, str(robot.source.urdf), pin.GeometryType.VISUAL, package_dirs=folders
    ).geometryObjects
    drawn = {part.name: part.mesh for part in load_body(robot).parts}
    several = 0
    for visual in [each for each in visuals if isinstance(each.geometry, coal.BVHModelBase)]:
        vertices, mesh = np.reshape(visual.geometry.vertices(), (-1, 3)), drawn[visual.name]
        several += _is_misread(visual.geometry, visual.meshPath)
        np.testing.assert_allclose(mesh.positions.min(axis=0), vertices.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(mesh.positions.max(axis=0), vertices.max(axis=0), atol=1e-6)
        assert mesh.faces.max() + 1 == len(mesh.positions)
    assert several > 0


def test_joints_are_where_pinocchio_has_them(solo12) -> None:
    rng = np.random.default_rng(5)
    q = np.array([pin.integrate(solo12.model, solo12.q_reference, 0.3 * rng.normal(size=18)) for _ in range(4)])
    scene, data = Scene(), solo12.create_data()
    body = load_body(solo12)
    body.animate(scene, np.arange(4.0), q)
    content = unpack(scene.pack({}))
    for joint in {part.joint for part in body.parts}:
        moved = tracks(content, f"/robot/{solo12.model.names[joint]}")
        position = moved[".position"]["values"].reshape(-1, 3)
        quaternion = moved[".quaternion"]["values"].reshape(-1, 4)
        for k in range(4):
            pin.forwardKinematics(solo12.model, data, q[k])
            np.testing.assert_allclose(position[k], data.oMi[joint].translation, atol=2e-5)
            rotation = pin.Quaternion(quaternion[k].astype(np.float64)).normalized().toRotationMatrix()
            np.testing.assert_allclose(rotation, data.oMi[joint].rotation, atol=1e-4)


def test_quaternions_are_continuous_in_sign(solo12) -> None:
    """A full turn passes all signs of the quaternion's entries; the keys must be continuous."""
    turns = np.linspace(0.0, 2.0 * np.pi, 40)
    q = np.tile(solo12.q_reference, (40, 1))
    q[:, 3:7] = np.column_stack((0 * turns, 0 * turns, np.sin(turns / 2), np.cos(turns / 2)))
    q[20:, 3:7] *= -1.0
    scene = Scene()
    load_body(solo12).animate(scene, np.arange(40.0), q)
    keys = tracks(unpack(scene.pack({})), "/robot/root_joint")[".quaternion"]["values"].reshape(-1, 4)
    assert np.all(np.sum(keys[1:] * keys[:-1], axis=1) > 0.9)


def test_a_robot_without_its_meshes_is_a_stick_figure_and_the_reason_is_logged(solo12, tmp_path, caplog) -> None:
    bare = tmp_path / "bare.urdf"
    text = solo12.source.urdf.read_text()
    bare.write_text(text.replace("package://", "package://nowhere/"))
    body = load_body(replace(solo12, source=ModelSource(bare)))
    assert {part.name.partition("_")[0] for part in body.parts} == {"ball", "bar"}
    (message,) = (record.getMessage() for record in caplog.records)
    assert message.startswith("solo12 is drawn as a stick figure: ") and "package://nowhere/" in message
    _, highest = body.bounds(solo12.q_reference)
    assert 0.2 < highest[2] < 0.35


def test_the_trunk_is_measured_in_its_own_axes(solo12) -> None:
    half = load_body(solo12).trunk_half_sides()
    assert 0.15 < half[0] < 0.3
    assert 0.05 < half[1] < 0.2
    assert 0.02 < half[2] < 0.08
