"""Every key of a config changes something that is computed.

Each leaf key gets another valid value. Of a closed loop, what is compared are the logs and verdicts of short runs in
which the key should act: standing and pushed, walking, falling, folding its legs, with an estimator and late drives. Of
a problem to solve, they are the fingerprints of the problem, its guess, and the figures of the guess: numbers, arrays
and expressions, not the settings that a built object merely holds.
"""

from __future__ import annotations

import fnmatch
import hashlib
import io
import json
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
import pytest

import lgmpc.compile.index
import lgmpc.config.build
import lgmpc.config.solving
from lgmpc.config import Config, SolveConfig, load_config, load_solve_config, parse_any_config
from lgmpc.config.build import prepare
from lgmpc.config.schema import Document
from lgmpc.config.solving import build_scenario, prepare_solve
from lgmpc.errors import InputError
from lgmpc.problems import Scenario
from lgmpc.robot import Robot
from lgmpc.runs import Gate, SolveGate, judge
from lgmpc.settings import Settings
from lgmpc.solvers import SolverSettings

TRIPOD = Path(__file__).resolve().parents[1] / "robot" / "data" / "tripod.urdf"
USED_AS_THEY_ARE = (SolveGate, SolverSettings)

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

STANDING = {"duration_s": 0.06, "pushes.0.time_s": 0.01}
LATE = {"timing.computing": "modelled", "delays.measurement_s": 0.003, "plant.link.command_latency_s": 0.002}
SCENES: tuple[dict[str, Any], ...] = (STANDING, {**STANDING, **LATE, "estimator": {"kind": "ground_truth"}})
"""Changes of the config of the small robot that give short runs, in one of which a key of its loop acts."""

TROT = "commands=[{at_s: 0.01, velocity_m_s: [0.4, 0.2, 0.0], yaw_rate_rad_s: 1.0, height_m: 0.01, pitch_rad: 0.05, "
PUSH = "pushes=[{{body: base_link, time_s: {}, duration_s: 0.05, impulse_ns: [{}, {}, {}]}}]"


class Scene(NamedTuple):
    """A short run of Solo12 in which some keys act.

    Attributes:
        config: shipped config.
        changes: that make it short.
        keys: glob patterns of the keys.
    """

    config: str
    changes: Sequence[str]
    keys: Sequence[str]


SOLO = {
    "walk": Scene(
        "solo12_velocity",
        [
            f"{TROT}roll_rad: 0.05, gait: fast_trot}}, {{at_s: 0.3, gait: stand}}]",
            PUSH.format(0.2, 0, 2, 0),
            "duration_s=0.4",
        ],
        (
            *("commands.0.*", "commands.1.at_s", "commands.1.gait", "locomotion.gaits.0.*", "locomotion.footholds.*"),
            *("locomotion.swing.apex_share", "locomotion.swing.clearance_m", "locomotion.swing.[ft]*"),
            *("locomotion.contacts.touch_time_s", "locomotion.contacts.ramp_s"),
            *("locomotion.contacts.release_s", "locomotion.reference.*", "locomotion.limits.*", "locomotion.clock.*"),
            *("mpc.qp_solver", "mpc.stepping_weights.com", "wbc.joint_horizon_s"),
            *("wbc.weights.swing", "wbc.stepping_weights.*", "wbc.gains.swing.*"),
            "wbc.solver",
        ),
    ),
    "estimate": Scene(
        "solo12_velocity",
        [f"{TROT}gait: trot}}]", "estimator={kind: inekf}", "joint_friction={excitation_s: 0.01}", "duration_s=0.3"],
        (
            "estimator.joint_velocity_noise_rad_s",
            "estimator.resting_speed_m_s",
            "estimator.outlier_probability",
            "joint_friction.*",
            "locomotion.contacts.lookahead_s",
            "mpc.observer_noise_share",
        ),
    ),
    "weak motor": Scene(
        "solo12_motor_fault",
        ["plant.actuators.faults=[{joint: FL_KFE, at_s: 0.05, torque_share: 0.5}]", "duration_s=0.25"],
        ("plant.actuators.faults.*", "joint_faults.*"),
    ),
    "uphill": Scene(
        "solo12_velocity",
        [
            *("world={kind: slope, angle_deg: 12}", "commands=[{at_s: 0.01, velocity_m_s: [1, 0, 0], gait: trot}]"),
            *("delays.measurement_s=0.002", "plant.link.measurement_latency_s=0.002", "duration_s=0.5"),
            "locomotion.limits.acceleration_m_s2=5",
        ],
        ("locomotion.contacts.touchdown_tolerance_s", "locomotion.terrain.filter_share"),
    ),
    "thrown up in a trot": Scene(
        "solo12_velocity",
        ["commands=[{at_s: 0.01, velocity_m_s: [0.4, 0, 0], gait: trot}]", PUSH.format(0.2, 0, 0, 4), "duration_s=0.5"],
        ("locomotion.contacts.lost_time_s",),
    ),
    "blocks": Scene(
        "solo12_velocity",
        [
            *("world={kind: blocks_20mm, seed: 1}", "commands=[{at_s: 0.01, velocity_m_s: [0.3, 0, 0], gait: trot}]"),
            "duration_s=1.5",
        ],
        ("locomotion.contacts.max_late_s",),
    ),
    "known map": Scene(
        "solo12_stones",
        [
            "world.ahead_m=0.3",
            "commands.0.at_s=0.01",
            "locomotion.terrain.map.drift_m_per_m=0.01",
            "locomotion.terrain.map.noise_m=0.001",
            "duration_s=0.8",
        ],
        ("locomotion.terrain.map.[!kd]*", "locomotion.terrain.edge_margin_m"),
    ),
    "seen map": Scene(
        "solo12_stones",
        [
            "world.ahead_m=0.3",
            "commands.0.at_s=0.01",
            "locomotion.terrain.map={kind: elevation, noise_m: 0.001}",
            "duration_s=0.8",
        ],
        ("locomotion.terrain.map.[!k]*",),
    ),
    "steps": Scene(
        "solo12_step_recovery",
        [PUSH.format(0.01, 0, 3, 0), "duration_s=1.2", "timing.computing=modelled"],
        ("locomotion.reaction.*", "mpc.catching_weights.com", "timing.forecast_ms"),
    ),
    "pushed trot": Scene(
        "solo12_velocity",
        [
            "commands=[{at_s: 0.01, velocity_m_s: [0.4, 0, 0], gait: trot}]",
            PUSH.format(0.2, 0, 3.5, 0),
            "duration_s=0.6",
        ],
        ("locomotion.swing.acceleration_m_s2", "locomotion.swing.longest_share"),
    ),
    "tilted": Scene(
        "solo12_fall",
        [PUSH.format(0.01, 0, 6, 0), "duration_s=0.6", "modes.fall.tracking_s=0.03"],
        ("modes.fall.tilt_error_deg", "modes.fall.tracking_s"),
    ),
    "fall": Scene(
        "solo12_fall",
        [PUSH.format(0.01, 0, 6, 0), "after_fall_s=0.1", "duration_s=0.6"],
        ("after_fall_s", "wbc.fallback_damping_nms", "modes.fall.tilt_deg", "modes.fall.height_share"),
    ),
    "lie": Scene(
        "solo12_rise",
        [
            *("modes.lying.rise_s=0.2", "modes.lying.load_s=0.1", "duration_s=0.9"),
            "commands=[{at_s: 0.02, mode: stand}, {at_s: 0.5, mode: lie}]",
        ],
        ("modes.lying.*", "commands.1.mode"),
    ),
    "stopped": Scene(
        "solo12_rise",
        ["commands=[{at_s: 0.02, mode: damp}, {at_s: 0.3, mode: stand}]", "duration_s=0.8"],
        ("modes.lie_still_s",),
    ),
    "weak": Scene(
        "solo12_fall",
        ["plant.actuators.torque_limit_nm=0.3", "duration_s=0.6"],
        ("modes.fall.low_s", "modes.fall.height_error_share"),
    ),
    "thrown": Scene("solo12_fall", [PUSH.format(0.01, 8, 0, 12), "duration_s=0.4"], ("modes.fall.unsupported_s",)),
    "unsolved": Scene(
        "solo12_stand", ["wbc.solver=proxqp", "wbc.max_iterations=1", "duration_s=0.05"], ("wbc.max_iterations",)
    ),
    "base held": Scene(
        "solo12_stand", ["wbc.weights.base_position=10", "duration_s=0.1"], ("wbc.gains.base_position.*",)
    ),
    "hand": Scene(
        "solo12_stand",
        [
            "wbc.hands=[{frame: FL_FOOT, relative_to: world, integral_gain: 1000, largest_error_m: 0.001, reach_m: 0.1,"
            "moves: [{at_s: 0.01, duration_s: 0.05, position_m: [0.2, 0.1, -0.1], rpy_deg: [0, 5, 0]}]}]",
            "duration_s=0.06",
        ],
        ("wbc.hands.*",),
    ),
    "circle": Scene(
        "solo12_com_circle", ["reference.start_s=0", "reference.ramp_s=0.05", "duration_s=0.1"], ("reference.*",)
    ),
}
QUICK = ("walk", "circle", "base held", "unsolved")
"""Scenes of the fast tests."""

BALL = {
    "first": {"kind": "capsule", "link": "panda_hand", "radius_m": 0.1, "half_length_m": 0.1},
    "second": {"kind": "sphere", "link": "universe", "center_m": [0.5, 0.0, 0.5], "radius_m": 0.1},
    "weight": 100.0,
}

OTHER: dict[str, Any] = {
    "*/locomotion.reaction.margin_m": -0.2,
    "*/locomotion.contacts.max_late_s": 0.0,
    "walk/robot.contact_frames": ("foot_b", "foot_a", "foot_c"),
    "walk/robot.posture": {"slide_*": 0.02},
    "walk/robot.position_limit_rad": (-0.2, 0.5),
    "walk/robot.one_sided_rad": {"slide_*": 0.005},
    "walk/robot.collision_shapes.?.link": "leg_a",
    "*/problem.world.kind": "slope",
    "walk/world.kind": "slope",
    "walk/world.kin?": "floor",
    "*/world.soft": {"stiffness_n_m": 4000.0, "damping_ns_m": 60.0},
    "walk/sensors.torque_noise_nm": 100.0,
    "walk/timing.tick_ms": (0.1, 0.2),
    "walk/timing.plan_ms": (0.1, 0.2),
    "steps/timing.forecast_ms": (0.1, 0.2),
    "walk/wbc.tasks": ({"use": "own_parts:Height"},),
    "walk/mpc.costs": ({"use": "own_parts:Level"},),
    "walk/mpc.friction": 0.02,
    "walk/mpc.normal_force_n": (1.0, 50.0),
    "walk/wbc.normal_force_n": (1.0, 50.0),
    "walk/estimator.contact_force_n": (20.0, 40.0),
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
    "*/mpc.qp_solver": "osqp",
    "*/mpc.friction_facets": 8,
    "*/wbc.friction_facets": 8,
    "*/mpc.observer_noise_share": 1e-6,
    "*/wbc.joint_acceleration_max_rad_s2": 5.0,
    "*/wbc.max_iterations": 50,
    "*/wbc.hands.0.frame": "FR_FOOT",
    "*/commands.0.velocity_m_s": (0.2, 0.0, 0.0),
    "*/commands.?.gait": "trot",
    "*/commands.0.height_m": -0.01,
    "*/commands.0.mode": "lie",
    "*/commands.1.mode": "damp",
    "*/locomotion.gaits.0.offsets": (0.0, 0.4, 0.6, 0.0),
    "*/locomotion.gaits.0.width": 0.5,
    "*/locomotion.clock.min_stance_s": 0.2,
    "*/locomotion.swing.longest_share": 1.0,
    "*/locomotion.reference.max_yaw_lead_rad": 1e-3,
    "*/locomotion.reaction.gait": "walk",
    "*/locomotion.reaction.return_speed_m_s": 0.01,
    "*/locomotion.limits.speed_m_s": 0.1,
    "*/locomotion.limits.yaw_rate_rad_s": 0.1,
    "*/joint_friction.largest_share": 1e-3,
    "*/plant.actuators.faults": ({"joint": "slide_a", "at_s": 0.0},),
    "*/plant.actuators.faults.0.joint": "FR_KFE",
    "*/modes.fall.tilt_error_deg": 2.0,
    "*/modes.fall.height_error_share": 0.1,
    "*/modes.fall.unsupported_s": 0.05,
}
"""Other values of keys, as "config/key" in glob patterns, whose valid ones cannot be guessed."""

EXEMPT: dict[str, str] = {
    "name": "the name of the run's folder",
    "robot.model": "another source of the model, exclusive with urdf",
    "robot.urdf": "the file of the model",
    "robot.srdf": "a file beside the model",
    "robot.package_dirs": "folders of meshes, which nothing here reads",
    "robot.floating_base": "a fixed base is refused in a closed loop, and for a quadruped",
    "wbc.short_support_weights.*": "of robots with a short support, see tests/test_humanoids.py",
    "robot.feet": "soles in place of contact_frames, see tests/robot/test_soles.py",
    "robot.collision_shapes": "only a plant has them; walked in a closed loop, shape by shape",
    "robot.collision_shapes.?.kind": "selects a shape; the keys of all shapes are walked",
    "changes": "settings of the other keys",
    "maneuvers": "planned motions, see tests/test_maneuvers.py",
    "commands.?.maneuver": "their names",
    "commands": "walked entry by entry where there are some",
    "modes.rearm": "of robots that fell, see tests/test_modes.py",
    "modes.fall.failing_s": "of robots whose solver fails, see tests/control/test_modes.py",
    "mpc.costs": "modules of users",
    "wbc.tasks": "modules of users",
    "wbc.hands": "walked entry by entry where there are some",
    "wbc.joint_acceleration_max_rad_s2": "of joints near their limits, see tests/wbc",
    "mpc.reach_rad": "of joints that plans move far, see tests/mpc",
    "mpc.stale_after": "of plans that fail, see tests/mpc",
    "estimator.rest_s": "of feet that slid, see tests/estimation/test_legged.py",
    "locomotion.gaits": "walked entry by entry where there are some",
    "locomotion.gaits.?.name": "commands refer to it",
    "locomotion.swing.search_*": "of feet that find no ground, see tests/locomotion/test_swing.py",
    "locomotion.contacts.early_share": "of feet that touch early in a swing, see tests/locomotion/test_contacts.py",
    "locomotion.contacts.max_search_s": "of feet that find no ground, see tests/locomotion/test_contacts.py",
    "locomotion.terrain.level_deg": "of gentle slopes, see tests/locomotion",
    "locomotion.terrain.steepest_deg": "of steep slopes, see tests/locomotion",
    "modes.displaced_m": "of feet far from their place, see tests/control/test_steps.py",
    "modes.displaced_s": "of feet far from their place, see tests/control/test_steps.py",
    "robot.collision_shapes.?.*": "of bodies that touch the ground, see tests/simulation/test_plants.py",
    "deployment.*": "of `lgmpc deploy`, whose tests are in tests/hardware",
    "sensors.external_*": "of external poses, see tests/estimation/test_external.py",
    "estimator.external_*": "of external poses, see tests/estimation/test_external.py",
    "estimator.kind": "selects an estimator; the keys of all estimators are walked",
    "locomotion.terrain.map.kind": "selects a map; the keys of all maps are walked",
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
def _interpreted(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, written: Written) -> None:
    """Nothing is compiled but for Solo12: what is compared are expressions and numbers."""
    if "solo12" in request.node.name.partition("[")[0]:
        return
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

    def cached(self, make: Any, *arguments: Any) -> Any:
        content = lgmpc.compile.index._content(make, arguments)
        if content is None:
            return make(*arguments)
        if content.data not in self.entries:
            _, given = content.restored()
            made = make(*given)
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


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small robot on three legs, each joint of one coordinate."""
    path = tmp_path_factory.mktemp("robot") / "tripod.urdf"
    text = TRIPOD.read_text(encoding="utf-8").replace('type="continuous"', 'type="revolute"')
    path.write_text(text.replace('effort="2" velocity="50"', 'effort="2" velocity="50" lower="-1" upper="1"'))
    return path


def exempt(key: str) -> bool:
    return any(fnmatch.fnmatchcase(key, each) for each in EXEMPT)


def without_effect(config: Document, keys: Sequence[str], printed: Callable[[Any], Any]) -> list[str]:
    """Return the keys whose change changes nothing that is computed."""
    before = printed(config)
    assert printed(config) == before, "two builds of the same config differ"
    return [key for key in keys if not exempt(key) and printed(changed(config, key)) == before]


def outcome(config: Document) -> str:
    """Return the fingerprint of what a run records, without durations, and of its verdict; or why it is refused."""
    assert isinstance(config, Config)
    try:
        session = prepare(config)
    except InputError as error:
        return str(error)
    result = session.run(lambda progress: None)
    log = {name: value for name, value in vars(result.log).items() if not name.endswith("_ms")}
    return fingerprint([log, result.verdict.outcome.value, list(result.verdict.reasons), result.certificate])


def inert(config: Document, keys: Sequence[str]) -> list[str]:
    """Return the keys whose change leaves a run as it is."""
    own = [key for key in keys if not exempt(key)]
    before = outcome(config) if own else ""
    return [key for key in own if outcome(changed(config, key)) == before]


def in_solo(key: str) -> bool:
    return any(fnmatch.fnmatchcase(key, pattern) for scene in SOLO.values() for pattern in scene.keys)


def scenes(urdf: Path, model: str = "centroidal") -> list[Document]:
    """Return short runs of the small robot."""
    config = parse_any_config(LOOP.format(urdf=urdf, model=model))
    return [config.replace(changes) for changes in SCENES]


def test_every_key_of_a_closed_loop_changes_what_is_computed(urdf: Path) -> None:
    configs = scenes(urdf)
    known = {key for config in configs for key in leaves(config)}
    left = [key for key in known if not in_solo(key) and not key.startswith(("gate.", "locomotion.", "modes."))]
    for config in configs:
        own = set(leaves(config))
        left = [key for key in left if key not in own] + inert(config, [key for key in left if key in own])
    assert left == [], ", ".join(left)


@pytest.mark.slow
def test_every_key_that_the_centroidal_model_lacks_changes_solo12s_motion() -> None:
    trot = "commands=[{at_s: 0.02, velocity_m_s: [0.3, 0.0, 0.0], gait: trot}]"  # feet in the air have weights too
    changes = [PUSH.format(0.01, 0, 1, 0), trot, "duration_s=0.12"]
    config, centroidal = load_config("solo12_balance_full_body", changes), load_config("solo12_balance", changes)
    left = inert(config, [key for key in leaves(config) if key not in set(leaves(centroidal))])
    assert left == [], ", ".join(left)


@pytest.mark.parametrize(
    "name", [each if each in QUICK else pytest.param(each, marks=pytest.mark.slow) for each in SOLO]
)
def test_every_key_of_solo12s_loop_changes_what_is_computed(name: str) -> None:
    scene = SOLO[name]
    config = load_config(scene.config, [*scene.changes, "log.rate_hz=1000"])
    keys = [key for key in leaves(config) if any(fnmatch.fnmatchcase(key, pattern) for pattern in scene.keys)]
    assert keys
    left = inert(config, keys)
    assert left == [], ", ".join(left)


def test_every_key_of_gaits_and_modes_is_in_a_scene() -> None:
    known = {key for scene in SOLO.values() for key in leaves(load_config(scene.config, scene.changes))}
    left = [key for key in known if key.startswith(("locomotion.", "modes.")) and not exempt(key) and not in_solo(key)]
    assert left == [], ", ".join(left)


def test_every_key_of_the_gate_changes_the_verdict(urdf: Path) -> None:
    metrics = prepare(scenes(urdf)[0]).run(lambda progress: None).metrics  # type: ignore[arg-type]
    assert metrics is not None
    metrics = replace(metrics, torque_saturation_fraction=0.5, solver_failures=3)
    reasons = judge(metrics, Gate()).reasons
    strict = {True: 1e-9, False: 1e6}
    limits = [key for key in leaves(Gate()) if key.startswith(("max_", "min_")) and key != "max_falls"]
    left = []
    for key in limits:
        for value in (strict[key.startswith("max_")], int(not key.startswith("max_")), 10, 1.0):
            try:
                gate = Gate().replace({key: value})
            except InputError:
                continue
            if judge(metrics, gate).reasons != reasons:
                break
        else:
            left.append(key)
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
    # How soft contacts are is the plant's matter: those of plans are rigid.
    keys = [key for key in leaves(config) if key.startswith(sections) and "world.soft" not in key]
    left = without_effect(config, keys, print_of_problem)
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
