"""Every key of a config reaches something that is built from it.

The walk gives each leaf key another valid value and compares fingerprints of what is built: all numbers, arrays and
texts in the attributes of plant, controllers, estimator, sensors, recorder and gate; of a problem to solve, those of
the problem, its guess, the figures of the guess, and the solver. Settings that a built object merely holds do not
count, but for those that are used as they are (those of gates, pushes, feet, solvers); a key of a closed loop that is
only read later has to change what 60 ticks record.
"""

from __future__ import annotations

import fnmatch
import hashlib
import io
import json
import pickle
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from enum import Enum
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
import pytest

import lgmpc.compile.index
import lgmpc.config.build
import lgmpc.config.solving
from lgmpc.config import Config, SolveConfig, load_solve_config, parse_any_config
from lgmpc.config.build import build_robot, prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.schema import Document
from lgmpc.config.solving import build_scenario, prepare_solve
from lgmpc.control.lying import LyingSettings
from lgmpc.control.modes import FallSettings, ModeSettings
from lgmpc.control.reference import CircleReference, StandReference
from lgmpc.errors import InputError
from lgmpc.locomotion.clock import GaitClockSettings
from lgmpc.locomotion.command import CommandLimits
from lgmpc.locomotion.contacts import ContactEventSettings
from lgmpc.locomotion.footholds import FootholdSettings
from lgmpc.locomotion.gait import Gait
from lgmpc.locomotion.reaction import StepReactionSettings
from lgmpc.locomotion.reference import ReferenceSettings
from lgmpc.locomotion.swing import SwingSettings
from lgmpc.problems import Scenario
from lgmpc.robot import Robot
from lgmpc.runs import Gate, SolveGate
from lgmpc.settings import Settings
from lgmpc.simulation.disturbances import Push
from lgmpc.simulation.drives import Drives, StateLink
from lgmpc.simulation.initial import initial_state
from lgmpc.simulation.plant import make_plant
from lgmpc.solvers import SolverSettings
from lgmpc.world import World, make_world

TRIPOD = Path(__file__).resolve().parents[1] / "robot" / "data" / "tripod.urdf"
USED_AS_THEY_ARE = (
    *(Gate, SolveGate, Push, CircleReference, StandReference, SolverSettings),
    *(Gait, GaitClockSettings, FootholdSettings, SwingSettings, ContactEventSettings, ReferenceSettings, CommandLimits),
    *(StepReactionSettings, ModeSettings, LyingSettings, FallSettings),
)

LOOP = """
name: walk
robot:
  urdf: {urdf}
  contact_frames: [foot_a, foot_b, foot_c]
  effort_limit_nm: 30.0
  velocity_limit_rad_s: 30.0
  position_limit_rad: [-0.1, 0.4]
  armature_kg_m2: 0.01
  posture: {{"slide_*": 0.01}}
  collision_shapes:
    - {{kind: sphere, link: body, radius_m: 0.05}}
    - {{kind: box, link: body, half_size_m: [0.1, 0.1, 0.1]}}
    - {{kind: capsule, link: body, radius_m: 0.05, half_length_m: 0.1}}
plant: {{actuators: {{stall_torque_nm: 4.0, no_load_speed_rad_s: 40.0}}}}
estimator: {{kind: inekf}}
joint_friction: {{}}
reference: {{kind: com_circle}}
pushes: [{{body: body, time_s: 1.0, impulse_ns: [0, 1, 0]}}]
mpc: {{model: {model}, nodes: 3, node_s: 0.02}}
"""

WALKING = """
locomotion:
  gaits: [{{name: hop, period_s: 0.5, duty: 0.6, offsets: [0.0, 0.3, 0.6]}}]
  reaction: {{gait: hop}}
commands: [{{at_s: 1.0, velocity_m_s: [0.1, 0.0, 0.0], yaw_rate_rad_s: 0.1, height_m: -0.01, gait: stand}}]
"""

BALL = {
    "first": {"kind": "capsule", "link": "panda_hand", "radius_m": 0.1, "half_length_m": 0.1},
    "second": {"kind": "sphere", "link": "universe", "center_m": [0.5, 0.0, 0.5], "radius_m": 0.1},
    "weight": 100.0,
}

OTHER: dict[str, Any] = {
    "walk/robot.contact_frames": ("foot_b", "foot_a", "foot_c"),
    "walk/robot.posture": {"slide_*": 0.02},
    "walk/robot.position_limit_rad": (-0.2, 0.5),
    "walk/robot.one_sided_rad": {"slide_*": 0.005},
    "walk/robot.collision_shapes.?.link": "leg_a",
    "walk/world.kind": "slope",
    "walk/world.kin?": "floor",
    "walk/sensors.torque_noise_nm": 100.0,
    "walk/timing.tick_ms": (0.1, 0.2),
    "walk/timing.plan_ms": (0.1, 0.2),
    "walk/wbc.tasks": ({"use": "own_parts:Height"},),
    "walk/mpc.costs": ({"use": "own_parts:Level"},),
    "walk/mpc.friction": 0.02,
    "walk/mpc.normal_force_n": (1.0, 50.0),
    "walk/wbc.normal_force_n": (1.0, 50.0),
    "walk/estimator.contact_force_n": (1.0, 5.0),
    "walk/pushes.0.body": "leg_a",
    "walk/locomotion.gaits.0.duty": 0.7,
    "walk/locomotion.reaction.gait": "stand",
    "walk/locomotion.gaits.0.offsets": (0.0, 0.2, 0.4),
    "walk/commands.0.velocity_m_s": (0.2, 0.0, 0.0),
    "walk/commands.0.gait": "hop",
    "walk/commands.0.mode": "lie",
    "solo12_trot/robot.contact_frames": ("FR_FOOT", "FL_FOOT", "HL_FOOT", "HR_FOOT"),
    "solo12_trot/robot.posture": {"F?_HFE": 0.7, "F?_KFE": -1.4, "H?_HFE": -0.7, "H?_KFE": 1.4},
    "solo12_trot/robot.position_limit_rad": {"*_HAA": (-0.8, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)},
    "solo12_trot/robot.one_sided_rad": {"*_KFE": 0.1},
    "solo12_trot/problem.phases.0.air": ("FR_FOOT", "HL_FOOT"),
    "talos_reach/problem.frame": "gripper_right_base_link",
    "talos_reach/problem.contact_gains": {"left_sole_link": (100.0, 20.0)},
    "talos_reach/problem.clearances": (
        {
            "first": {"kind": "sphere", "link": "gripper_left_base_link", "radius_m": 0.1},
            "second": {"kind": "sphere", "link": "universe", "radius_m": 0.1},
        },
    ),
    "solo12_*/problem.contact_gains": {"FL_FOOT": (100.0, 20.0)},
    "panda_reach/problem.clearances": (BALL,),
    "panda_reach/problem.clearances.0.*.link": "panda_link4",
    "panda_reach/problem.clearances.0.first.half_length_m": 0.01,  # the ball is nearest to an end then
    "panda_reach/problem.frame": "panda_hand",
    "*/problem.rotors.frames": ("iris__rotor_1", "iris__rotor_0", "iris__rotor_2", "iris__rotor_3"),
    "*/problem.rotors.turning": ("cw", "cw", "ccw", "ccw"),
    "iris_loop/problem.waypoints.0.time_s": 0.6,
    "iris_loop/problem.waypoints.1.time_s": 1.2,
    "iris_loop/problem.waypoints.2.time_s": 2.1,
    "iris_loop/problem.node_s": 0.015,
    "*/solver.step_lengths": (1.0, 0.5),
    "*/solver.regularization": (1e-8, 1e8),
}
"""Other values of keys, as "config/key" in glob patterns, whose valid ones cannot be guessed."""

EXEMPT: dict[str, str] = {
    "name": "the name of the run's folder",
    "robot.model": "another source of the model, exclusive with urdf",
    "robot.urdf": "the file of the model",
    "robot.srdf": "a file beside the model",
    "robot.package_dirs": "folders of meshes, which nothing here reads",
    "robot.floating_base": "a fixed base is refused in a closed loop, and for a quadruped",
    "robot.collision_shapes": "only a plant has them; walked in a closed loop, shape by shape",
    "robot.collision_shapes.?.kind": "selects a shape; the keys of all shapes are walked",
    "changes": "settings of the other keys",
    "deployment.silence_s": "of `lgmpc deploy`, whose tests are in tests/hardware",
    "deployment.lost_s": "of `lgmpc deploy`",
    "deployment.damping_nms": "of `lgmpc deploy`",
    "estimator.kind": "selects an estimator; the keys of all estimators are walked",
    "reference.kind": "selects a reference; the keys of all references are walked",
    "mpc.model": "selects a model; the keys of all models are walked",
    "problem.kind": "selects a problem; the keys of all problems are walked",
    "problem.clearances.?.*.kind": "selects a shape",
    "problem.phases": "exclusive with pattern; the keys of phases are walked in a config that has some",
    "solver.method": "selects a solver; the keys of all solvers are walked",
}


ACT_LATE = ("stale_after", "reach_rad", "fallback_damping_nms")
"""Settings that act only after failures of a solver: the settings that the controllers hold count for these."""


def walk(thing: Any, seen: set[int]) -> Iterator[Any]:
    """Yield everything in the attributes of ``thing`` that is a number, a text or an array, in a fixed order."""
    if thing is None or isinstance(thing, (bool, int, float, str, bytes, np.generic, Enum, Path)):
        yield repr(thing)
        return
    if id(thing) in seen:
        return
    seen.add(id(thing))
    _KEPT.append(thing)  # an address may not be used again while the walk compares addresses
    if isinstance(thing, np.ndarray):
        yield thing.dtype.str + str(thing.shape)
        yield thing.tobytes() if thing.dtype != object else repr(thing.tolist())
    elif isinstance(thing, Settings) and not isinstance(thing, USED_AS_THEY_ARE):
        return
    elif isinstance(thing, Settings):
        yield thing.model_dump_json()
    elif isinstance(thing, Mapping):
        for key, value in thing.items():
            yield repr(key)
            yield from walk(value, seen)
    elif isinstance(thing, (Sequence, set, frozenset)):
        for value in thing if isinstance(thing, Sequence) else sorted(thing, key=repr):
            yield from walk(value, seen)
    elif isinstance(thing, Robot):  # its fields only: cached properties are there or not
        yield from walk([getattr(thing, field.name) for field in fields(thing)], seen)
    elif isinstance(thing, ca.Function):
        yield str(thing.serialize())
    elif isinstance(thing, (ca.SX, ca.MX, ca.DM, ca.Sparsity)):
        yield str(thing)
    elif isinstance(thing, mujoco.MjModel):
        yield from (np.asarray(getattr(thing, name)).tobytes() for name in _arrays_of(thing))
        yield from (repr(getattr(thing.opt, name)) for name in sorted(dir(thing.opt)) if not name.startswith("_"))
    elif isinstance(thing, pin.Model):
        yield thing.saveToString()
    elif type(thing).__module__.startswith("proxsuite") and hasattr(thing, "settings"):
        yield repr((thing.settings.eps_abs, thing.settings.max_iter))
    elif callable(thing) and hasattr(thing, "__closure__"):
        yield thing.__qualname__
        for cell in thing.__closure__ or ():
            yield from walk(cell.cell_contents, seen)
    else:
        yield type(thing).__qualname__
        own = {**getattr(thing, "__dict__", {}), **{name: getattr(thing, name, None) for name in _slots(thing)}}
        for name, value in own.items():
            if not name.startswith("__"):
                yield name
                yield from walk(value, seen)
        yield from walk(getattr(thing, "__self__", None), seen)


_KEPT: list[Any] = []


def _arrays_of(model: mujoco.MjModel) -> list[str]:
    return [name for name in sorted(dir(model)) if isinstance(getattr(model, name, None), np.ndarray)]


def _slots(thing: Any) -> list[str]:
    return [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ()) if isinstance(name, str)]


def fingerprint(thing: Any) -> str:
    """Return a hash of everything that ``walk`` finds."""
    digest = hashlib.sha256()
    for each in walk(thing, set()):
        digest.update(each if isinstance(each, bytes) else each.encode())
    _KEPT.clear()
    return digest.hexdigest()


def leaves(settings: Settings, prefix: str = "") -> Iterator[str]:
    """Yield the dotted keys of all values that are no tables."""
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        if isinstance(value, Settings):
            yield from leaves(value, f"{prefix}{name}.")
        elif isinstance(value, tuple) and value and all(isinstance(each, Settings) for each in value):
            for i, each in enumerate(value):
                yield from leaves(each, f"{prefix}{name}.{i}.")
        else:
            yield prefix + name
    yield from (prefix + name for name in settings.model_extra or {})


def candidates(settings: Document, key: str) -> Iterator[Any]:
    """Yield other values of a key, the likely ones first."""
    known = [value for each, value in OTHER.items() if fnmatch.fnmatchcase(f"{settings.name}/{key}", each)]
    if known:
        yield from known
        return
    here: Any = settings
    *outer, name = key.split(".")
    for part in outer:
        here = here[int(part)] if part.isdecimal() else getattr(here, part)
    value, field = getattr(here, name), type(here).model_fields.get(name)
    annotation = None if field is None else field.annotation
    yield from (each for each in _literals(annotation) if each != value)
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value - 1)
    elif isinstance(value, float):
        yield from (2.0 * value, 0.5 * value, value + 0.5, value + 0.01)
    elif isinstance(value, tuple) and value and all(isinstance(each, float) for each in value):
        yield from (tuple(2.0 * each + shift for each in value) for shift in (0.0, 0.01))
    elif isinstance(value, dict):
        yield {each: 0.9 * number for each, number in value.items()}
    elif value is None:
        yield from (1, 0.5, (0.1, 0.2), (0.1, 0.2, 0.3), "x")
    elif isinstance(value, str):
        yield value + "_"


def _literals(annotation: Any) -> Iterator[Any]:
    if get_origin(annotation) is Literal:
        yield from get_args(annotation)
    else:
        for inner in get_args(annotation):
            yield from _literals(inner)


def changed(config: Document, key: str) -> Document:
    """Return the config with another valid value at ``key``."""
    for value in candidates(config, key):
        try:
            other = config.replace({key: value})
        except InputError:
            continue
        if other != config:
            return other
    raise AssertionError(f"no other valid value of {key} was found: add one to OTHER")


@pytest.fixture(autouse=True)
def _interpreted(monkeypatch: pytest.MonkeyPatch, written: Written) -> None:
    """Nothing is compiled: what is compared are expressions and numbers."""
    monkeypatch.setenv("LGMPC_JIT", "0")
    cached = lgmpc.compile.cached
    for module in [each for name, each in sys.modules.items() if name.startswith("lgmpc.")]:
        if vars(module).get("cached") is cached:
            monkeypatch.setattr(module, "cached", written.cached)


class Written:
    """What was written from equal arguments is not written again, as in the cache's index, but interpreted."""

    def __init__(self) -> None:
        self.entries: dict[bytes, bytes] = {}
        self.functions: dict[int, ca.Function] = {}

    def cached(self, make: Any, *arguments: Any, progress: Any = None) -> Any:
        content = lgmpc.compile.index._content(make, arguments)
        if content is None:
            return make(*arguments, progress=progress)
        if content.data not in self.entries:
            _, given = content.restored()
            made = make(*given, progress=progress)
            pickler = pickle.Pickler(buffer := io.BytesIO(), pickle.HIGHEST_PROTOCOL)
            pickler.persistent_id = self._name  # type: ignore[method-assign]
            pickler.dump(made)
            self.entries[content.data] = buffer.getvalue()
        unpickler = pickle.Unpickler(io.BytesIO(self.entries[content.data]))
        unpickler.persistent_load = self.functions.__getitem__  # type: ignore[method-assign]
        return unpickler.load()

    def _name(self, thing: Any) -> int | None:
        """Return the name of a function, which all copies share; None for what every copy has of its own."""
        if not isinstance(thing, ca.Function):
            return None
        self.functions[id(thing)] = thing
        return id(thing)


@pytest.fixture(scope="module")
def written() -> Written:
    return Written()


class Parts:
    """Builds of parts that several configs share, each built and hashed once for the same arguments."""

    def __init__(self) -> None:
        self.built: dict[Any, tuple[Any, str]] = {}
        self.used: list[str] = []
        self.enabled = True

    def cached(self, build: Any) -> Any:
        def build_once(*arguments: Any, **keywords: Any) -> Any:
            if not self.enabled:
                return build(*arguments, **keywords)
            plain = [repr(each) for each in arguments if isinstance(each, (Settings, World, float, int, str))]
            if build is make_plant:
                plain += [repr(each.given_shapes) for each in arguments if isinstance(each, Robot)]
            key = (build, *plain)
            if key not in self.built:
                made = build(*arguments, **keywords)
                self.built[key] = made, fingerprint(made)
            made, printed = self.built[key]
            self.used.append(printed)
            return made

        return build_once


_PARTS = Parts()


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> Parts:
    """Let a change of one section build only what it is handed to."""
    for name in ("make_mpc", "WholeBodyController", "make_plant", "JointFrictionEstimator"):
        monkeypatch.setattr(lgmpc.config.build, name, _PARTS.cached(getattr(lgmpc.config.build, name)))
    monkeypatch.setattr(lgmpc.config.build, "LeggedEstimator", _PARTS.cached(lgmpc.config.build.LeggedEstimator))
    return _PARTS


def print_of_loop(config: Config, parts: Parts) -> tuple[Any, ...]:
    """Return the fingerprints of all that a closed loop is built of."""
    parts.used.clear()
    session = prepare(config)
    own = [session.robot, session.recorder, session.gate, session.pushes, session.rates, session.log_every]
    own += [session.initial, session.after_fall_s]
    controller, planner = vars(session.controller), session.controller.planner
    pieces = [vars(session.sensing), session.hardware.drives, session.hardware.computing]
    pieces.append({name: value for name, value in controller.items() if name not in ("robot", "wbc", "planner")})
    if planner is not None:
        pieces.append({name: value for name, value in vars(planner).items() if name != "mpc"})
    return (*parts.used, *(fingerprint(each) for each in (*own, *pieces)))


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small robot on three legs, each joint of one coordinate."""
    path = tmp_path_factory.mktemp("robot") / "tripod.urdf"
    text = TRIPOD.read_text(encoding="utf-8").replace('type="continuous"', 'type="revolute"')
    path.write_text(text.replace('effort="2" velocity="50"', 'effort="2" velocity="50" lower="-1" upper="1"'))
    return path


def exempt(key: str) -> bool:
    return any(fnmatch.fnmatchcase(key, each) for each in EXEMPT)


def without_effect(config: Document, keys: Sequence[str], printed: Any) -> list[str]:
    """Return the keys whose change changes nothing of what is built."""
    before = printed(config)
    _PARTS.built.clear()
    assert printed(config) == before, "two builds of the same config differ"
    return [key for key in keys if not exempt(key) and printed(changed(config, key)) == before]


def unused(config: Document, keys: Sequence[str], printed: Any, run: Any) -> list[str]:
    """Return the keys whose change changes neither what is built nor, as a second chance, what a short run records."""
    left = without_effect(config, keys, printed)
    recorded = run(config) if left else ""
    return [key for key in left if run(changed(config, key)) == recorded]


def recorded_by(config: Document) -> str:
    """Return the fingerprint of the log of 60 ticks, without durations; and of settings that act in failures only."""
    assert isinstance(config, Config)
    _PARTS.enabled = False
    try:
        session = prepare(config.replace({"duration_s": 0.06, "pushes.0.time_s": 0.01}))
        log = vars(session.run(lambda progress: None).log)
    finally:
        _PARTS.enabled = True
    return fingerprint([{name: value for name, value in log.items() if not name.endswith("_ms")}, acting_late(session)])


def acting_late(session: ClosedLoopSession) -> list[float]:
    """Return the values that the controllers hold of the settings that act in failures only."""
    wbc, mpc = session.controller.wbc.settings, getattr(session.controller.planner, "mpc", None)
    return [getattr(held, name) for name in ACT_LATE for held in (wbc, mpc and mpc.settings) if hasattr(held, name)]


def test_every_key_of_a_closed_loop_is_built_into_something(urdf: Path, parts: Parts) -> None:
    config = parse_any_config(LOOP.format(urdf=urdf, model="centroidal"))
    keys = [key for key in leaves(config) if not key.startswith(("commands", "locomotion."))]
    left = unused(config, keys, lambda each: print_of_loop(each, parts), recorded_by)
    assert left == [], ", ".join(left)


@pytest.mark.parametrize("model", ["kinodynamic", "full_body"])
def test_every_key_that_the_centroidal_model_lacks_is_built_into_something(
    model: str, urdf: Path, parts: Parts
) -> None:
    config, centroidal = (parse_any_config(LOOP.format(urdf=urdf, model=each)) for each in (model, "centroidal"))
    keys = [key for key in leaves(config) if key not in set(leaves(centroidal))]
    assert keys and all(key.startswith("mpc.") for key in keys)
    left = unused(config, keys, lambda each: print_of_loop(each, parts), lambda each: acting_late(prepare(each)))
    assert left == [], ", ".join(left)


def test_every_key_of_the_regulator_is_built_into_something(urdf: Path, parts: Parts) -> None:
    config = parse_any_config(LOOP.format(urdf=urdf, model="lqr"))
    keys = [key for key in leaves(config) if key.startswith("mpc.")]
    left = unused(config, keys, lambda each: print_of_loop(each, parts), recorded_by)
    assert left == [], ", ".join(left)


@pytest.mark.parametrize("world", ["floor", "slope"])
def test_every_key_of_plant_and_world_is_built_into_the_plant(urdf: Path, world: str) -> None:
    """Friction and masses are also those by which the log is judged: that alone does not suffice."""
    config = parse_any_config(LOOP.format(urdf=urdf, model="centroidal") + f"world: {world}\n")
    keys = [key for key in leaves(config) if key.startswith(("plant.", "world."))]

    def print_of_plant(each: Document) -> str:
        assert isinstance(each, Config)
        robot, world = build_robot(each), make_world(each.world, each.plant.friction)
        rng, link = np.random.default_rng(0), each.plant.link
        drives = [Drives(link, each.plant.actuators, each.plant.dt, rng), StateLink(link, rng)]
        return fingerprint([make_plant(robot, each.plant, world), initial_state(robot, each.plant, world), *drives])

    assert without_effect(config, keys, print_of_plant) == []


def test_every_key_of_commands_and_locomotion_is_built_into_something(urdf: Path, parts: Parts) -> None:
    config = parse_any_config((LOOP + WALKING).format(urdf=urdf, model="centroidal"))
    keys = [key for key in leaves(config) if key.startswith(("commands.", "locomotion."))]
    left = without_effect(config, keys, lambda each: print_of_loop(each, parts))
    assert left == [], ", ".join(left)


def print_of_problem(config: Document) -> str:
    """Return the fingerprint of a problem, its guess, and the figures of the guess."""
    assert isinstance(config, SolveConfig)
    scenario = build_scenario(config)
    return fingerprint([scenario, dict(scenario.figures(scenario.guess))])


def print_of_solve(config: Document) -> str:
    """Return the fingerprint of the solver, with the settings that it holds, and of the gate."""
    assert isinstance(config, SolveConfig)
    session = prepare_solve(config)
    return fingerprint([type(session.solver).__name__, session.solver.settings, session.gate])


PHASES = ["problem.pattern=null", "problem.phases=[{duration_s: 0.2, air: [FL_FOOT, HR_FOOT], height_m: 0.05}]"]


@pytest.mark.parametrize(
    ("name", "overrides", "sections"),
    [
        ("solo12_trot", (), ("problem.", "robot.")),
        ("solo12_trot", PHASES, ("problem.phases.",)),
        ("solo12_jump", (), ("problem.",)),
        ("solo12_jump_free_time", (), ("problem.",)),
        ("solo12_righting", ["problem.nodes=10", "problem.node_s=0.03", "problem.strokes.ramp_s=0.06"], ("problem.",)),
        ("solo12_com_circle_full_body", (), ("problem.",)),
        ("talos_reach", (), ("problem.",)),
        ("panda_reach", (), ("problem.",)),
        ("panda_reach", [f"problem.clearances=[{json.dumps(BALL)}]"], ("problem.clearances.",)),
        ("iris_loop", (), ("problem.",)),
        ("upside_down_recovery", (), ("problem.",)),
    ],
)
def test_every_key_of_a_problem_is_built_into_something(
    name: str, overrides: Sequence[str], sections: tuple[str, ...]
) -> None:
    config = load_solve_config(name, overrides)
    left = without_effect(config, [key for key in leaves(config) if key.startswith(sections)], print_of_problem)
    assert left == [], ", ".join(left)


@pytest.mark.parametrize("method", ["box_fddp", "al_fddp", "sqp", "ipopt", "fatrop"])
def test_every_key_of_a_solver_reaches_the_solver(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    built: dict[str, Scenario] = {}

    def build_once(given: SolveConfig) -> Scenario:
        key = given.robot.model_dump_json() + given.problem.model_dump_json()
        if key not in built:
            built[key] = build_scenario(given)
        return built[key]

    monkeypatch.setattr(lgmpc.config.solving, "build_scenario", build_once)  # all solvers derive from its expressions
    config = load_solve_config("panda_reach", [f"solver={{method: {method}}}", "problem.nodes=2"])
    sections = ("solver.", "gate.") if method == "box_fddp" else ("solver.",)
    keys = [key for key in leaves(config) if key.startswith(sections)]
    if method == "fatrop":
        keys.remove("solver.time_limit_s")  # fatrop cannot be interrupted: null is its only value
    left = without_effect(config, keys, print_of_solve)
    assert left == [], ", ".join(left)
