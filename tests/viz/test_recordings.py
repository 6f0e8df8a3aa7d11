"""MCAP and .rrd, read back with the packages of their formats."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from mcap.reader import make_reader
from rerun.chunk import RrdReader

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import Run
from lgmpc.viz.overlay import Frames
from lgmpc.viz.recordings import RATE_HZ, write_mcap, write_rrd
from lgmpc.world import World, make_world
from lgmpc.world.settings import Stairs

Fields = dict[int, list[Any]]


def fields_of(message: bytes) -> Fields:
    """The fields of a protobuf message by number: its wire format, which needs no package."""
    found: Fields = {}
    i = 0

    def varint() -> int:
        nonlocal i
        value = shift = 0
        while True:
            byte = message[i]
            i += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while i < len(message):
        key = varint()
        kind = key & 7
        if kind == 0:
            value: Any = varint()
        else:
            size = {1: 8, 5: 4}.get(kind) or varint()
            value, i = message[i : i + size], i + size
            value = float(np.frombuffer(value, "<f8")[0]) if kind == 1 else value
        found.setdefault(key >> 3, []).append(value)
    return found


def numbers(message: bytes, count: int) -> list[float]:
    fields = fields_of(message)
    return [fields.get(k, [0.0])[0] for k in range(1, count + 1)]


@pytest.fixture(scope="module")
def stairs() -> World:
    return make_world(Stairs(ahead_m=3.0), 0.6)


@pytest.fixture(scope="module")
def mcap(solo12: Robot, pushed_run: Run, stairs: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("mcap") / "run.mcap"
    write_mcap(file, solo12, pushed_run, stairs)
    return file


def messages(file: Path, topic: str) -> Iterator[tuple[int, bytes]]:
    with file.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics=[topic]):
            yield message.log_time, message.data


def test_mcap_has_foxgloves_schemas_and_every_channel(mcap: Path, pushed_run: Run) -> None:
    log = pushed_run.log
    with mcap.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        metadata = {each.name: each.metadata for each in reader.iter_metadata()}
    assert summary is not None and summary.statistics is not None
    schemas = {each.topic: summary.schemas[each.schema_id].name for each in summary.channels.values()}
    counts = {each.topic: summary.statistics.channel_message_counts[each.id] for each in summary.channels.values()}
    assert schemas["/tf"] == "foxglove.FrameTransforms" and schemas["/joint_states"] == "foxglove.JointStates"
    assert {schemas[each] for each in ("/robot", "/world", "/marks")} == {"foxglove.SceneUpdate"}
    pictures = len(Frames.of(log, RATE_HZ).ticks)
    assert counts["/tf"] == counts["/marks"] == pictures and counts["/joint_states"] == log.ticks
    logged = {name for name in pushed_run.channels if name not in ("time", "mpc_time")}
    assert {topic.removeprefix("/log/") for topic in schemas if topic.startswith("/log/")} == logged
    assert metadata["lgmpc"]["config"] == pushed_run.config and metadata["lgmpc"]["verdict"] == "pass"


def test_channels_of_mcap_are_the_log_to_the_last_bit(mcap: Path, pushed_run: Run) -> None:
    log = pushed_run.log
    read = list(messages(mcap, "/log/contact_forces"))
    values = np.array([list(json.loads(data).values()) for _, data in read])
    assert np.array_equal(values.reshape(-1, 4, 3), log.contact_forces)
    assert [at for at, _ in read] == np.round(1e9 * log.time).astype(int).tolist()
    assert list(json.loads(read[0][1]))[:2] == ["FL_FOOT.x", "FL_FOOT.y"]


def test_transforms_of_mcap_are_pinocchios_of_every_link(mcap: Path, solo12: Robot, pushed_run: Run) -> None:
    log, data = pushed_run.log, solo12.create_data()
    ticks = Frames.of(log, RATE_HZ).ticks
    links = {each.name: i for i, each in enumerate(solo12.model.frames) if each.type == pin.FrameType.BODY}
    for k, (_, message) in enumerate(messages(mcap, "/tf")):
        pin.framesForwardKinematics(solo12.model, data, log.q[ticks[k]])
        transforms = fields_of(message)[1]
        assert len(transforms) == len(links.keys() - {"universe"})
        for each in map(fields_of, transforms):
            assert each[2] == [b"world"]
            pose = pin.SE3ToXYZQUAT(data.oMf[links[each[3][0].decode()]])
            read = [*numbers(each[4][0], 3), *numbers(each[5][0], 4)]
            assert np.array_equal(read, pose)


def test_arrows_of_mcap_point_along_the_contact_forces(mcap: Path, pushed_run: Run) -> None:
    log = pushed_run.log
    frames = Frames.of(log, RATE_HZ)
    forces, pushes, ratios = frames.mean(log.contact_forces), 0, []
    for k, (_, message) in enumerate(messages(mcap, "/marks")):
        entities = {fields_of(each)[3][0].decode(): fields_of(each) for each in fields_of(message)[2]}
        pushes += len(entities["push"].get(7, ()))
        arrows = [fields_of(each) for each in entities["forces"].get(7, ())]
        for arrow, foot in zip(arrows, np.flatnonzero(log.closed[frames.ticks[k]]), strict=False):
            pose = fields_of(arrow[1][0])
            turn = pin.Quaternion(np.array(numbers(pose[2][0], 4)))
            assert np.allclose(numbers(pose[1][0], 3), log.contact_points[frames.ticks[k], foot])
            force = forces[k, foot]
            assert np.allclose(turn.matrix()[:, 0], force / np.linalg.norm(force), atol=1e-9)
            ratios.append((arrow[2][0] + arrow[4][0]) / np.linalg.norm(force))
    assert pushes == np.count_nonzero(np.linalg.norm(log.push[frames.ticks, :3], axis=1)) > 0
    assert len(ratios) > len(frames.ticks) and np.allclose(ratios, ratios[0])


def test_robot_and_ground_of_mcap_are_triangles(mcap: Path, stairs: World) -> None:
    (_, robot), (_, world) = (next(messages(mcap, topic)) for topic in ("/robot", "/world"))
    parts = [fields_of(each) for each in fields_of(robot)[2]]
    assert {each[2][0].decode() for each in parts} >= {"base_link", "FL_LOWER_LEG"} and len(parts) >= 13
    assert all(fields_of(each[12][0])[2] for each in parts)
    assert len(fields_of(world)[2]) == len(stairs.surfaces)


def test_rrd_has_poses_forces_meshes_and_every_channel(
    solo12: Robot, pushed_run: Run, stairs: World, tmp_path: Path
) -> None:
    log, file = pushed_run.log, tmp_path / "run.rrd"
    write_rrd(file, solo12, pushed_run, stairs)
    chunks: dict[str, Any] = {}
    static = set()
    for chunk in RrdReader(file).stream():
        path = chunk.entity_path.lstrip("/")
        if chunk.is_static:
            static.add(path)
        else:
            chunks.setdefault(path, []).append(chunk.to_record_batch())
    ticks = Frames.of(log, RATE_HZ).ticks

    def column(path: str, word: str) -> Any:
        parts = [batch.column(name) for batch in chunks[path] for name in batch.schema.names if word in name]
        return [value for part in parts for value in part.to_pylist()]

    assert np.array_equal(column("log/tau", "scalars"), log.tau)
    base = np.array(column("world/base_link", "translation")).reshape(-1, 3)
    assert np.allclose(base, log.q[ticks, :3], atol=1e-6)  # 32 bits
    assert [len(each) for each in column("world/forces", "vectors")] == [4] * len(ticks)
    assert {f"log/{name}" for name in pushed_run.channels if not name.endswith("time")} <= chunks.keys()
    assert any(path.startswith("world/base_link/") for path in static)
    assert sum(path.startswith("world/ground/") for path in static) == len(stairs.surfaces)
    seconds = [each.total_seconds() for each in column("log/tau", "time")]
    assert np.allclose(seconds, log.time, atol=1e-6)


def test_a_run_without_a_finite_tick_is_refused_and_leaves_no_file(
    solo12: Robot, pushed_run: Run, tmp_path: Path
) -> None:
    log = pushed_run.log
    lost = replace(pushed_run, log=replace(log, q=np.full_like(log.q, np.nan)))
    for write, name in ((write_mcap, "run.mcap"), (write_rrd, "run.rrd")):
        with pytest.raises(InputError, match="0 finite ticks"):
            write(tmp_path / name, solo12, lost, World())
    assert not list(tmp_path.iterdir())
