"""The index of the cache: what is made from the same is not made again; what is made from anything else is."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import lgmpc
import lgmpc.compile.content as content
import lgmpc.compile.index as index
from lgmpc.actions import CentroidalAction, ContactForwardDynamics
from lgmpc.compile import BatchKernel, StageKernel, cached
from lgmpc.costs import CostItem, Parameter, ParameterLayout
from lgmpc.costs.library import CoMPosition
from lgmpc.errors import InputError
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.wbc.settings import Gain
from lgmpc.wbc.tasks import SymbolicTask
from lgmpc.wbc.terms import WholeBodyTerms

pytestmark = pytest.mark.skipif(
    all(shutil.which(name) is None for name in ("cc", "gcc", "clang")), reason="no C compiler is installed"
)


@pytest.fixture(autouse=True)
def cache(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache for one test, and sources that are known."""
    monkeypatch.setattr(index, "_changed", lambda: False)
    index._sources.cache_clear()
    here = __name__.partition(".")[0]
    monkeypatch.setattr(content, "_IDENTIFIED", content._IDENTIFIED | {here})
    monkeypatch.setattr(content, "_PLAIN", re.compile(f"{content._PLAIN.pattern}|{here}"))
    written.clear()
    return empty_cache


@pytest.fixture(scope="module")
def robot() -> Robot:
    feet = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    return load_robot(RobotSpec(model="solo12", contact_frames=feet, effort_limit_nm=1.8, velocity_limit_rad_s=30.0))


written: list[Any] = []
"""What the functions below were called with."""


def scaled(factor: float) -> ca.Function:
    """A function that no parameter changes: its factor is a number in the code."""
    written.append(factor)
    x = ca.SX.sym("x", 2)
    return ca.Function("scaled", [x], [factor * x], ["x"], ["y"])


def height(robot: Robot) -> ca.Function:
    """The height of the first foot times the mass."""
    written.append(robot.name)
    q = ca.SX.sym("q", robot.nq)
    foot = robot.symbolic.frame_placement(q, robot.contact_frames[0]).translation[2]
    return ca.Function("height", [q], [robot.symbolic.mass * foot], ["q"], ["y"])


def value(kernel: StageKernel, x: Any) -> float:
    """Evaluate the first entry of the only output at one input."""
    (name, size), y = next(iter(kernel.input_sizes.items())), np.zeros(*kernel.output_sizes.values())
    assert kernel.bind(1, **{name: np.broadcast_to(np.asarray(x, dtype=float), size).copy()}, y=y)() == 0
    return float(y[0])


@pytest.mark.parametrize("kind", [StageKernel, BatchKernel])
def test_what_was_written_once_is_not_written_again(kind: type[StageKernel]) -> None:
    assert [value(kind.of(scaled, 3.0), [2.0, 0.0]) for _ in range(3)] == [6.0] * 3
    assert written == [3.0]


def test_every_difference_of_a_robot_is_another_kernel(robot: Robot) -> None:
    heavy, tall = robot.model.copy(), robot.model.copy()
    heavy.inertias[1] = pin.Inertia(2.0, heavy.inertias[1].lever, heavy.inertias[1].inertia)
    frame = tall.frames[robot.contact_ids[0]]
    frame.placement = frame.placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, 1e-9]))
    assert frame.placement.translation[2] != robot.model.frames[robot.contact_ids[0]].placement.translation[2]
    others = [
        _changed(robot, model=heavy),
        _changed(robot, model=tall),
        _changed(robot, contact_frames=robot.contact_frames[::-1]),
    ]
    q = robot.q_reference + 0.1
    for made in (robot, *others):
        expected = float(height(made)(q))
        written.clear()
        assert value(StageKernel.of(height, made), q) == pytest.approx(expected, rel=1e-15)
        assert len(written) == 1, "the kernel of another robot"
        assert value(StageKernel.of(height, made), q) == pytest.approx(expected, rel=1e-15)
        assert len(written) == 1
    numbers = [float(height(made)(q)) for made in (robot, *others)]
    assert len(set(numbers)) == len(numbers)


def _changed(robot: Robot, **changes: Any) -> Robot:
    return dataclasses.replace(robot, **changes)


def test_a_model_that_was_changed_afterwards_is_another(robot: Robot) -> None:
    mine = _changed(robot, model=robot.model.copy())
    before = value(StageKernel.of(height, mine), robot.q_reference)
    mine.model.inertias[1] = pin.Inertia(2.0, mine.model.inertias[1].lever, mine.model.inertias[1].inertia)
    after = value(StageKernel.of(height, mine), robot.q_reference)
    assert after == pytest.approx(before / robot.mass * float(pin.computeTotalMass(mine.model)), rel=1e-12)
    assert after != before


def test_a_robot_is_the_same_wherever_its_files_are(robot: Robot) -> None:
    WholeBodyTerms(robot)
    entries = _entries()
    elsewhere = _changed(robot, source=lgmpc.robot.ModelSource(Path("/elsewhere/solo12.urdf")), notes=("moved",))
    WholeBodyTerms(elsewhere)
    assert _entries() == entries != []


def _entries() -> list[str]:
    folder = Path(os.environ["LGMPC_CACHE_DIR"], "kernels")
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_structure_is_in_the_key() -> None:
    shapes = [(1, 4), (1, 8), (2, 4)]
    for contacts, facets in shapes * 2:
        sizes = BatchKernel.of(values, CentroidalAction(contacts, facets)).output_sizes
        assert sizes["constraint"] == contacts * (facets + 1)
    assert written == shapes


def values(action: CentroidalAction) -> ca.Function:
    """The values of an action at one point."""
    written.append((action.contacts, action.facets))
    return action.value_function


class RiseMotion(SymbolicTask):
    """Height of the base, times a number that is part of its expression."""

    dim = 1

    def __init__(self, factor: float, kp: float, weight: float) -> None:
        super().__init__(Gain(kp=kp), weight)
        self.factor = factor

    def position(self, s: Any) -> Any:
        """Return (1,) the height."""
        return self.factor * s.q[2]


def lifted(task: RiseMotion) -> ca.Function:
    """The task's memory, multiplied by its factor."""
    written.append(task.factor)
    memory = ca.SX.sym("memory", task.layout.size)
    return ca.Function("lifted", [memory], [task.factor * task.layout.split(memory)["kp"]], ["memory"], ["y"])


def test_gains_weights_and_targets_are_not_in_the_key() -> None:
    for kp, weight in ((100.0, 1.0), (50.0, 3.0)):
        task = RiseMotion(2.0, kp, weight)
        task.target.position[:] = kp
        assert value(StageKernel.of(lifted, task), task.memory) == 2.0 * kp
    assert written == [2.0]
    task = RiseMotion(3.0, 100.0, 1.0)
    assert value(StageKernel.of(lifted, task), task.memory) == 300.0
    assert written == [2.0, 3.0]


def test_numbers_that_are_not_in_the_key_are_not_known_when_expressions_are_written() -> None:
    with pytest.raises(AttributeError):
        StageKernel.of(_of_defaults, ParameterLayout(Parameter("mass", 1, "kg", 2.0)))


def _of_defaults(layout: ParameterLayout) -> ca.Function:
    return scaled(float(layout.default[0]))


def test_results_that_were_computed_before_are_no_part_of_the_key(robot: Robot) -> None:
    dynamics = ContactForwardDynamics(robot.model, robot.contact_frames)
    fresh, used = CentroidalAction(4, 4), CentroidalAction(4, 4)
    assert used.value_function.n_in() == 3
    assert _data(fresh) == _data(used)
    before = _data(dynamics)
    dynamics.robot.com(ca.SX.sym("q", robot.nq))
    assert _data(dynamics) == before


def _data(argument: Any) -> bytes:
    content = index._content(cached, (argument,))
    assert content is not None
    return content.data


@dataclasses.dataclass(frozen=True)
class Foreign:
    """Stands for a user's class, whose code has no version."""

    factor: float


def of_foreign(thing: Foreign) -> ca.Function:
    """A function of a user's object."""
    return scaled(thing.factor)


def test_code_from_outside_the_package_is_written_every_time(monkeypatch: pytest.MonkeyPatch, robot: Robot) -> None:
    monkeypatch.setattr(content, "_IDENTIFIED", content._IDENTIFIED - {__name__.partition(".")[0]})
    for _ in range(2):
        assert value(StageKernel.of(of_foreign, Foreign(2.0)), 1.0) == 2.0  # a function and a class
        StageKernel.of(scaled, 4.0)
    assert written == [2.0, 4.0, 2.0, 4.0]
    assert _entries() == []

    class Mine(CoMPosition):
        """A residual of the user's, derived from one of lgmpc's."""

    assert index._content(cached, (CostItem("mine", Mine()),)) is None
    assert index._content(cached, (CostItem("own", CoMPosition()),)) is not None


class _Numbers(dict[str, float]):
    """A container with attributes."""


@pytest.mark.parametrize(
    "thing",
    [lambda x: x, ca.SX.sym("x"), ca.MX.sym("x"), pin.SE3.Identity(), _Numbers(x=1.0), np.random.default_rng(0)],
    ids=["lambda", "SX", "MX", "SE3", "dict", "Generator"],
)
def test_what_has_no_content_is_not_cached(thing: Any) -> None:
    assert index._content(cached, (thing,)) is None


def test_sources_that_may_have_changed_are_not_indexed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.setattr(index, "__imported_ns__", 0)
    assert index._changed()
    index._sources.cache_clear()
    assert index._sources() is None
    index._sources.cache_clear()


def test_sources_that_change_under_way_write_no_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    StageKernel.of(scaled, 1.0)
    entries = _entries()
    monkeypatch.setattr(index, "_changed", lambda: True)
    StageKernel.of(scaled, 2.0)
    assert _entries() == entries
    StageKernel.of(scaled, 1.0)
    assert written == [1.0, 2.0]


def test_a_changed_source_is_another_index(tmp_path: Path) -> None:
    copy = tmp_path / "package"
    shutil.copytree(Path(lgmpc.__file__).parent, copy / "lgmpc", ignore=shutil.ignore_patterns("__pycache__"))
    script = "import lgmpc, lgmpc.compile.index as i; i.__imported_ns__ += 10**11; print(lgmpc.__file__, i._sources())"

    def sources() -> str:
        environment = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, env=environment, cwd=tmp_path, check=True
        )
        place, digest = done.stdout.split()
        assert place.startswith(str(copy))
        return digest

    before = sources()
    assert before == index._sources()
    file = copy / "lgmpc" / "robot" / "friction.py"
    stamp = file.stat()
    file.write_text(file.read_text().replace("2", "3", 1))
    os.utime(file, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert file.stat().st_size == stamp.st_size
    assert sources() != before


@pytest.mark.parametrize("damage", ["truncated", "altered", "no library", "other library"])
def test_a_damaged_entry_is_made_again(damage: str, cache: Path) -> None:
    StageKernel.of(scaled, 5.0)
    (entry,) = [path for path in (cache / "kernels").rglob("*") if path.is_file()]
    (library,) = cache.glob("scaled-*.so")
    if damage == "truncated":
        entry.write_bytes(entry.read_bytes()[:-10])
    elif damage == "altered":
        data = bytearray(entry.read_bytes())
        data[-20] ^= 1
        entry.write_bytes(data)
    elif damage == "no library":
        library.unlink()
    else:
        data = library.read_bytes()
        library.unlink()  # it is mapped: its file must not change
        library.write_bytes(data + b" ")
    index._load.cache_clear()
    assert value(StageKernel.of(scaled, 5.0), 1.0) == 5.0
    assert written == [5.0, 5.0]
    assert value(StageKernel.of(scaled, 5.0), 1.0) == 5.0
    assert written == [5.0, 5.0]


def test_environment_and_folder_are_in_the_key(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    StageKernel.of(scaled, 1.0)
    monkeypatch.setenv("LGMPC_CFLAGS", "-DANOTHER")
    StageKernel.of(scaled, 1.0)
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(tmp_path / "other"))
    StageKernel.of(scaled, 1.0)
    monkeypatch.setenv("LGMPC_JIT", "0")
    assert not StageKernel.of(scaled, 1.0).compiled
    assert written == [1.0] * 4


def test_the_index_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(index, "_ENTRIES", 4)
    for factor in range(12):
        StageKernel.of(scaled, float(factor))
        assert len(_entries()) <= 5
    assert value(StageKernel.of(scaled, 11.0), 1.0) == 11.0
    assert len(written) == 12


def test_threads_find_kernels_side_by_side() -> None:
    def work(k: int) -> float:
        return value(StageKernel.of(scaled, float(k % 3)), 1.0)

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(work, range(48))) == [float(k % 3) for k in range(48)]
    assert set(written) == {0.0, 1.0, 2.0}


def test_files_and_folders_are_the_users_alone_whatever_the_umask(cache: Path) -> None:
    before = os.umask(0)
    try:
        StageKernel.of(scaled, 1.0)
    finally:
        os.umask(before)
    folders = [cache, *(path for path in cache.rglob("*") if path.is_dir())]
    files = [path for path in cache.rglob("*") if path.is_file()]
    assert {path.stat().st_mode & 0o777 for path in folders} == {0o700}
    assert {path.stat().st_mode & 0o777 for path in files} == {0o600}
    assert (len(folders), len(files)) == (3, 2)


@pytest.mark.parametrize("depth", [0, 1])
@pytest.mark.parametrize("fault", ["mode", "owner", "link"])
def test_folders_that_others_may_write_to_are_refused(depth: int, fault: str, cache: Path, tmp_path: Path) -> None:
    StageKernel.of(scaled, 1.0)
    folder = next(iter([cache / "kernels", *(cache / "kernels").iterdir()][depth:]))
    if fault == "mode":
        folder.chmod(0o777)
    elif fault == "link":
        folder.rename(tmp_path / "elsewhere")
        folder.symlink_to(tmp_path / "elsewhere")
    elif os.geteuid() == 0:
        os.chown(folder, 12345, -1)
    else:
        pytest.skip("only root can give a folder away")
    words = {"mode": "others may write to.*0777", "link": "is a symbolic link", "owner": "another user"}[fault]
    with pytest.raises(InputError, match=words) as refusal:
        StageKernel.of(scaled, 1.0)
    assert str(folder) in str(refusal.value)


@pytest.mark.parametrize("what", ["entry", "library"])
@pytest.mark.parametrize("fault", ["mode", "owner", "link"])
def test_files_that_others_may_have_written_are_made_again(what: str, fault: str, cache: Path, tmp_path: Path) -> None:
    StageKernel.of(scaled, 1.0)
    (path,) = cache.glob("scaled-*.so") if what == "library" else (cache / "kernels").glob("*/*")
    content = path.read_bytes()
    if fault == "mode":
        path.chmod(0o620)
    elif fault == "link":
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    elif os.geteuid() == 0:
        os.chown(path, 12345, -1)
    else:
        pytest.skip("only root can give a file away")
    index._load.cache_clear()
    assert value(StageKernel.of(scaled, 1.0), 1.0) == 1.0
    assert written == [1.0, 1.0]
    assert not path.is_symlink() and path.stat().st_mode & 0o777 == 0o600 and path.stat().st_uid == os.geteuid()
    assert path.read_bytes() == content
    assert value(StageKernel.of(scaled, 1.0), 1.0) == 1.0
    assert written == [1.0, 1.0]


class _Planted:
    """Executes code when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return written.append, ("planted",)


def test_an_entry_executes_no_code(cache: Path) -> None:
    StageKernel.of(scaled, 1.0)
    (entry,) = (path for path in (cache / "kernels").rglob("*") if path.is_file())
    code = ["code", "builtins:print"]
    for tree in (code, ["made", "lgmpc.robot.symbolic.model:SymbolicModel", ["tuple", code]], ["original", 0, 0]):
        text = json.dumps(tree).encode()
        for data in (len(text).to_bytes(8, "little") + text, pickle.dumps(_Planted())):
            entry.write_bytes(hashlib.sha256(data).digest() + data)
            assert value(StageKernel.of(scaled, 1.0), 1.0) == 1.0
    assert set(written) == {1.0} and len(written) == 7


def test_lgmpc_imports_no_pickle() -> None:
    imports = re.compile(r"^\s*(import|from) (pickle|_pickle|marshal|shelve|joblib)\b", re.MULTILINE)
    sources = Path(lgmpc.__file__).parent.rglob("*.py")
    assert [path.name for path in sources if imports.search(path.read_text())] == []


def test_a_model_with_infinite_numbers_has_a_content_and_a_kernel(robot: Robot) -> None:
    mine = _changed(robot, model=robot.model.copy())
    mine.model.lowerPositionLimit[:] = -np.inf
    mine.model.upperPositionLimit[0] = np.nan
    expected = float(height(mine)(robot.q_reference))
    written.clear()
    for _ in range(2):
        assert value(StageKernel.of(height, mine), robot.q_reference) == pytest.approx(expected, rel=1e-15)
    assert len(written) == 1
    given = index._content(cached, (mine,)).restored()[1][0]  # type: ignore[union-attr]
    assert np.array_equal(given.model.lowerPositionLimit, mine.model.lowerPositionLimit)
    assert _data(mine) == _data(given) != _data(robot)
    dynamics = ContactForwardDynamics(mine.model, mine.contact_frames)
    (restored,) = index._content(cached, (dynamics,)).restored()[1]  # type: ignore[union-attr]
    assert _data(restored) == _data(dynamics)
