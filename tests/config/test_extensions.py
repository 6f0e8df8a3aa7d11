"""Tasks and costs of one's own, named in a config."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lgmpc
from lgmpc.config import Config, load_config, parse_config
from lgmpc.config.build import build_controller, build_robot, prepare
from lgmpc.config.extensions import own_costs, own_tasks
from lgmpc.errors import ConfigError
from lgmpc.mpc import FullBodyMpc, FullBodyMpcSettings

from .conftest import ROOT

STAND = ROOT / "configs" / "solo12_stand.yaml"
HEIGHT = "wbc.tasks=[{use: 'own_parts:Height', gain: {kp: 300}, weight: 50, arguments: {at: 0.2}}]"
FULL_BODY = ("mpc={model: full_body, nodes: 3}",)


def own(*changes: str) -> Config:
    return load_config(STAND, changes)


def test_reading_a_config_imports_nothing() -> None:
    config = own("wbc.tasks=['no_such_module:Task']", *FULL_BODY, "mpc.costs=['no_such_module:Cost']")
    assert config.wbc.tasks[0].use == "no_such_module:Task"
    assert parse_config(lgmpc.config.dump_config(config)) == config


@pytest.mark.usefixtures("interpreted")
def test_tasks_have_gain_weight_arguments_and_a_place_in_the_qp() -> None:
    config = own(HEIGHT, "wbc.tasks.1=own_parts:Stiff")
    controller = build_controller(config, build_robot(config))
    tasks = controller.wbc.tasks
    assert [each for each in tasks if each not in ("com", "posture")][-2:] == ["height", "Stiff"]
    height = tasks["height"]
    assert (height.kp[0], height.kd[0], height.weight[0], height.target.position[0]) == (300.0, 2 * 300**0.5, 50.0, 0.2)


def test_a_task_of_a_config_moves_the_robot(tmp_path: Path) -> None:
    """The base stands 3 cm lower than without the task."""
    ends = []
    for changes in ((), (HEIGHT, "wbc.weights.com=[10.0, 10.0, 1e-3]")):
        session = prepare(load_config("solo12_stand", ["duration_s=1.0", "mpc.enabled=false", *changes]))
        ends.append(session.run(lambda now: None).log.q[-1, 2])
    assert ends[1] == pytest.approx(0.2, abs=2e-3) and ends[0] > 0.22


@pytest.mark.usefixtures("interpreted")
def test_costs_of_a_config_are_those_of_the_mpc_in_the_units_of_its_weights() -> None:
    config = own(
        *FULL_BODY,
        "mpc.costs=[{use: 'own_parts:Level', weight: 7.0}, {use: 'own_parts:slow_joints', arguments: {scale: 0.5}}]",
    )
    robot = build_robot(config)
    costs = own_costs(config, robot)
    assert [(each.name, each.weight) for each in costs] == [("level", 7.0), ("slow_joints", 0.5)]
    settings = config.mpc
    assert isinstance(settings, FullBodyMpcSettings)
    problem = FullBodyMpc(robot, settings, costs=costs).problem
    np.testing.assert_allclose(problem.view("level_weight")[0], 7.0 / settings.node_s)
    np.testing.assert_allclose(problem.view("level_weight")[-1], 7.0 * settings.weights.terminal)
    plain = FullBodyMpc(robot, settings).problem
    x = robot.x_reference.copy()
    x[3:7] = [np.sin(0.1), 0.0, 0.0, np.cos(0.1)]  # a roll of 0.2 rad
    added = problem.evaluate(0, x, np.zeros(robot.nu)).cost - plain.evaluate(0, x, np.zeros(robot.nu)).cost
    assert added == pytest.approx(0.5 * 7.0 * np.sin(0.2) ** 2, rel=1e-6)


CASES = {
    "wbc.tasks=[height]": "wbc.tasks.0: got the text 'height'; expected module:name, such as my_module:HandTask",
    "wbc.tasks=['own_part:Height']": "no module 'own_part'; expected a module in .*, or an installed one",
    "wbc.tasks=['own_parts:Heigth']": "wbc.tasks.0: got no 'Heigth' in .*own_parts.py; .* Did you mean Height",
    "wbc.tasks=['own_parts:nothing']": "own_parts:nothing, which returns NoneType; expected a task",
    "wbc.tasks=['own_parts:failing']": r"own_parts:failing, which fails \(RuntimeError: it has no battery\)",
    "wbc.tasks=[{use: 'own_parts:Height', arguments: {att: 1}}]": "unexpected keyword argument 'att'",
    "wbc.tasks=[{use: 'own_parts:Height', weigth: 1}]": "Did you mean wbc.tasks.0.weight",
    "wbc.tasks=['own_parts:Twice']": "wbc.tasks: got tasks: two called 'com'",
    "wbc.tasks=['own_parts:Short']": r"wbc.tasks: got velocity of task 'Short': shape \(3, 1\)",
    "mpc.costs=['own_parts:nothing']": "mpc.costs.0: got own_parts:nothing, which returns NoneType; expected a cost",
}


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("change", CASES)
def test_one_error_names_what_cannot_be_used(change: str) -> None:
    with pytest.raises(ConfigError, match=CASES[change]):
        config = own(*(FULL_BODY if change.startswith("mpc") else ()), change)
        build_controller(config, build_robot(config))


def test_a_module_beside_the_config_is_found_and_one_that_fails_is_named(tmp_path: Path) -> None:
    (tmp_path / "beside_the_config.py").write_text("from own_parts import Height as Own\n", encoding="utf-8")
    (tmp_path / "fails_when_imported.py").write_text("1 / 0\n", encoding="utf-8")
    file = tmp_path / "small.yaml"
    file.write_text(STAND.read_text(encoding="utf-8"), encoding="utf-8")
    config = load_config(file, ["wbc.tasks=['beside_the_config:Own']"])
    assert [task.name for task in own_tasks(config, build_robot(config))] == ["height"]
    config = load_config(file, ["wbc.tasks=['fails_when_imported:Own']"])
    with pytest.raises(ConfigError, match=r"import fails \(ZeroDivisionError: division by zero\)"):
        own_tasks(config, build_robot(config))


def test_only_the_model_with_joints_has_costs_of_ones_own() -> None:
    with pytest.raises(ConfigError, match="a key that only mpc.model = full_body has"):
        own("mpc.costs=['own_parts:Level']")
