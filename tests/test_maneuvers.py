"""Manoeuvres in closed loop: what was planned is performed, on both plants, anywhere, on an estimate."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config import load_config
from lgmpc.config.build import prepare
from lgmpc.config.robots import build_robot
from lgmpc.config.session import SessionResult
from lgmpc.control.maneuver import Maneuver
from lgmpc.errors import ConfigError, InputError
from lgmpc.runs import Metrics
from lgmpc.simulation.initial import initial_state
from lgmpc.simulation.parameters import PlantSettings

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
SHORT = ("commands=[{at_s: 0.2, maneuver: jump}]", "duration_s=2.5")


def run(name: str, *overrides: str) -> SessionResult:
    return prepare(load_config(CONFIGS / f"{name}.yaml", overrides)).run(lambda progress: None)


def measured(name: str, *overrides: str) -> Metrics:
    result = run(name, *overrides)
    assert result.verdict.passed, result.verdict.reasons
    assert isinstance(result.metrics, Metrics)
    return result.metrics


def test_a_jump_is_performed_as_planned() -> None:
    modes = measured("solo12_jump_executed", *SHORT).modes
    assert modes is not None and modes.maneuvers == 1
    assert modes.maneuver_rise_m == pytest.approx(0.111, abs=0.004)  # planned 111 mm; measured 111.5
    assert modes.maneuver_distance_m == pytest.approx(0.2, abs=0.005)  # measured 201 mm
    assert modes.landing_tilt_deg is not None and modes.landing_tilt_deg < 3.0  # 1.8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "plant"),
    [
        *itertools.product(("solo12_jump", "go2_jump"), ("mujoco", "pinocchio")),
        *(("solo12_leap", "pinocchio"), ("solo12_spin", "mujoco"), ("anymal_jump", "mujoco")),
    ],
)
def test_the_shipped_manoeuvres_pass(config: str, plant: str) -> None:
    measured(f"{config}_executed", f"plant.kind={plant}")


@pytest.mark.parametrize(
    "changes",
    [
        ("plant.initial_height_m=0.35",),
        ("plant.initial_height_m=0.35", "plant.kind=pinocchio"),
        ("plant.initial_height_m=0", "plant.initial_velocity_m_s=[0.3, 0, 2.4]"),  # thrown up by 30 cm, and ahead
    ],
)
def test_a_robot_that_loses_the_ground_lands_on_its_feet(changes: tuple[str, ...]) -> None:
    modes = measured("solo12_catch", "duration_s=2", *changes).modes
    assert modes is not None and modes.maneuvers == 1
    assert modes.landing_tilt_deg is not None and modes.landing_tilt_deg < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["mujoco", "pinocchio"])
def test_a_robot_jumps_onto_a_box(plant: str) -> None:
    result = run("solo12_box", f"plant.kind={plant}")
    assert result.verdict.passed, result.verdict.reasons
    assert result.certificate is not None and result.certificate.certified
    assert isinstance(result.metrics, Metrics) and result.metrics.final_tilt_deg < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        ("world.start_yaw_deg=130", "world.start_m=[3, -2]", "world.height_m=-0.5"),
        ("estimator.kind=inekf",),
        (  # a late touchdown: legs whose clock did not follow the fall folded before it, and the robot struck the floor
            "plant.mass_scale=1.05",
            "plant.friction=0.5",
            "plant.link.command_latency_s=0.002",
            "gate.max_landing_tilt_deg=3",  # 1.6; 6 at the plan's own time
        ),
        ("plant.mass_scale=0.95", "plant.base_com_offset_m=[0.01, 0, 0]"),
    ],
)
def test_a_jump_is_performed_anywhere_and_on_other_robots(changes: tuple[str, ...]) -> None:
    measured("solo12_jump_executed", *SHORT, *changes)


@pytest.mark.slow
def test_a_robot_goes_to_the_place_from_where_it_jumps_over_a_bar() -> None:
    run = measured("solo12_bar", "duration_s=6", "world.start_m=[-0.03, 0.09]", "world.start_yaw_deg=-8")
    assert run.final_tilt_deg < 1.0


@pytest.mark.slow
def test_a_robot_that_is_tossed_up_on_its_back_turns_over_and_lands_on_its_feet() -> None:
    run = measured("solo12_righting_executed", "duration_s=3")
    assert run.modes is not None and run.modes.maneuvers == 1


@pytest.mark.parametrize(("tilt", "words"), [(0.0, None), (180.0, "180 degrees from upright")])
def test_a_fall_that_is_performed_ends_upright(tilt: float, words: str | None) -> None:
    robot = build_robot(load_config(CONFIGS / "solo12_catch.yaml"))
    turned = initial_state(robot, PlantSettings(initial_attitude_deg=(tilt, 0.0, 0.0), initial_height_m=1.0))
    flags, forces = np.zeros((1, 4), dtype=np.bool_), np.zeros((1, 4, 3))
    given = "fall", robot, np.array([0.0, 0.4]), np.array([turned, turned]), flags, forces, 1e-3
    if words is not None:
        with pytest.raises(InputError, match=words):
            Maneuver.of(*given)
        return
    fall = Maneuver.of(*given)
    assert fall.begins_in_the_air and fall.stance[-1].all()  # a landing follows
    assert np.abs(fall.q[-1, 7:] - robot.q_reference[7:]).max() < 1e-9


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["commands.1.maneuver=jmp"], r"commands\.1\.maneuver: got jmp; expected a name in .*Did you mean jump\?"),
        (
            ["maneuvers.jump={run: runs, problem: solo12_jump}"],
            r"maneuvers\.jump\.run: got .*expected either problem or run",
        ),
        (["maneuvers.jump={run: nowhere}"], r"maneuvers\.jump\.run: got nowhere; expected a run folder"),
        (["commands.1.mode=lie"], r"commands\.1\.maneuver: got jump; expected none in mode lie"),
        (["maneuvers.jump={problem: solo12_jum}"], r"maneuvers\.jump\.problem: got solo12_jum: no such file"),
        (["maneuvers.jump={problem: solo12_balance}"], r"maneuvers\.jump\.problem: .*the config of a closed loop"),
        (["maneuvers.jump.set={problem.yaw_dg: 1}"], r"maneuvers\.jump\.set: got problem\.yaw_dg: an unknown key"),
    ],
)
def test_a_manoeuvre_that_cannot_be_performed_is_one_error(changes: list[str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        prepare(load_config(CONFIGS / "solo12_jump_executed.yaml", changes))
