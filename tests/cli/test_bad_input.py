"""Wrong input of users: exit code 2, one screen, no traceback, and a remedy."""

import os
import threading
from pathlib import Path

import pytest
from rich.text import Text
from typer.testing import CliRunner

from lgmpc.cli.app import app
from lgmpc.cli.screen import out, show_table
from lgmpc.runs.tables import Table

from .conftest import BALANCE, Invoke

FIXED_BASE_ARM = """\
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="5" velocity="5"/>
  </joint>
</robot>
"""

CASES = {
    "a wrong key": (["plant.frction=0.6"], "--set: plant.frction: got an unknown key", "Did you mean plant.friction"),
    "a wrong type": (["mpc.rate_hz=fast"], "--set: mpc.rate_hz: got the text 'fast'", "expected a number"),
    "a robot that does not exist": (["robot.model=solo13"], "--set: robot.model: got solo13", "Did you mean solo12"),
    "a urdf that does not exist": (
        ["robot.model=null", "robot.urdf=no.urdf"],
        "--set: robot.urdf",
        "a file that exists",
    ),
    "no feet": (["robot.contact_frames=[]"], "--set: robot.contact_frames: got no frames", "FL_FOOT, FR_FOOT"),
    "a misspelt foot": (["robot.contact_frames=[FL_FOT]"], "contact frame 'FL_FOT' is not in the model", "FL_FOOT"),
    "limits that never bind": (["robot.effort_limit_nm=null"], "never binds (1000 N.m)", "give effort_limit_nm"),
    "a pattern without joints": (["robot.effort_limit_nm={'*_HAB': 1}"], "effort_limit_nm: '*_HAB'", "no joint"),
    "zero friction": (["plant.friction=0"], "--set: plant.friction: got 0", "greater than 0"),
    "a negative mass": (["plant.mass_scale=-1"], "--set: plant.mass_scale: got -1", "not below 0.01"),
    "a push on an unknown body": (["pushes.0.body=base_lnk"], "--set: pushes.0.body: got base_lnk", "base_link"),
    "NaN in a reference": (
        ["reference={kind: com_circle, radius_m: .nan}"],
        "--set: reference.radius_m: got NaN (.nan)",
        "a finite number",
    ),
    "a run of no tick": (["duration_s=0.0005"], "--set: duration_s: got 0.0005", "from 0.001 to 3600"),
    "a run of years": (["duration_s=1e9"], "--set: duration_s: got 1e+09", "from 0.001 to 3600"),
    "a horizon of one interval": (["mpc.nodes=1"], "--set: mpc.nodes: got 1", "not below 2"),
    "a horizon beyond reason": (["mpc.nodes=500"], "--set: mpc.nodes: got 500", "not above 200"),
    "feet that pull": (["mpc.normal_force_n=[-5, 3]"], "--set: mpc.normal_force_n.0: got -5", "not below 0"),
    "forces that cost nothing": (["mpc.weights.force=0"], "--set: mpc.weights.force: got 0", "greater than 0"),
    "a number that overflows": (
        ["pushes.0.impulse_ns=[1e300, 0, 0]"],
        "--set: pushes.0.impulse_ns.0",
        "not above 1e+09",
    ),
    "infinity": (["plant.friction=1e400"], "--set: plant.friction: got inf", "a finite number"),
    "a change that is none": (["mpc.enabled"], "--set: got mpc.enabled", "key=value"),
}


def assert_one_screen(output: str) -> None:
    assert "Traceback" not in output
    lines = sum(max(1, -(-len(line) // 80)) for line in output.splitlines())
    assert lines <= 24, output


@pytest.mark.parametrize("case", CASES)
def test_check_and_run_refuse_it_in_one_screen(case: str, invoke: Invoke, tmp_path: Path) -> None:
    changes, place, help_ = CASES[case]
    for command in (["check", BALANCE], ["run", BALANCE, "--out", tmp_path]):
        code, output = invoke(*command, "--set", changes[0], *changes[1:])
        assert code == 2
        assert place in output and help_ in output
        assert_one_screen(output)
    assert list(tmp_path.iterdir()) == [], "a run that cannot start leaves nothing behind"


def test_every_problem_of_a_config_is_on_the_one_screen(invoke: Invoke) -> None:
    changes = [f"plant.key_{i}=1" for i in range(30)] + ["plant.friction=0", "seed=x"]
    code, output = invoke("check", BALANCE, *changes)
    assert code == 2
    assert "32 problems in the config" in output and "and 22 more" in output
    assert_one_screen(output)


def test_another_robot_in_a_config_is_refused_in_one_screen(invoke: Invoke) -> None:
    code, output = invoke("check", BALANCE, "robot.model=talos", "pushes=[]")
    assert code == 2
    assert "robot 'talos' cannot be used" in output and "FL_FOOT" in output
    assert_one_screen(output)


def test_a_urdf_without_feet_is_refused(invoke: Invoke, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(FIXED_BASE_ARM, encoding="utf-8")
    config = tmp_path / "arm.yaml"
    config.write_text(
        "name: arm\nrobot: {urdf: arm.urdf, floating_base: false, effort_limit_nm: 1.0}\n", encoding="utf-8"
    )
    code, output = invoke("check", config)
    assert code == 2
    assert f"{config}:2: robot.floating_base: got a robot whose base is fixed (arm)" in output
    code, output = invoke("check", config, "robot.contact_frames=[foot]")
    assert code == 2
    assert "'foot' is not in the model" in output
    assert_one_screen(output)


def test_a_folder_that_cannot_be_written_is_refused_before_the_run(invoke: Invoke, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    code, output = invoke("run", BALANCE, "--out", tmp_path / "file" / "runs")
    assert code == 2
    assert "cannot create a run folder" in output and "--out" in output
    assert_one_screen(output)


def test_a_file_that_is_no_config_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.yaml").write_text("name: x\nrobot: [\n", encoding="utf-8")
    finished = CliRunner().invoke(app, ["run", "broken.yaml"])
    assert finished.exit_code == 2
    assert finished.stderr.startswith("error: broken.yaml:3: got broken YAML")
    assert finished.stdout == ""
    assert_one_screen(finished.stderr)


def test_a_missing_config_names_its_neighbour(invoke: Invoke) -> None:
    code, output = invoke("check", str(BALANCE).replace("balance", "balence"))
    assert code == 2
    assert "no such file" in output and f"Did you mean {BALANCE}" in output


@pytest.mark.parametrize(
    "arguments",
    [
        ["run"],
        ["run", BALANCE, "--plant", "gazebo"],
        ["fly"],
        ["run", BALANCE, "--nope"],
        ["robot", "x", "--port", "y"],
    ],
    ids=["run", "plant", "command", "option", "port"],
)
def test_a_command_that_does_not_exist_is_refused(arguments: list[object], invoke: Invoke) -> None:
    code, output = invoke(*arguments)
    assert code == 2
    assert_one_screen(output)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["deploy", BALANCE, "--interface", "eth7"], "--interface: got eth7; expected none: --driver udp"),
        (["deploy", BALANCE, "--driver", "unitree", "--robot", "1.2.3.4:5"], "--robot: got ('1.2.3.4', 5)"),
        (["robot", BALANCE, "--driver", "unitree", "--secret", "x"], "--secret: got x; expected none: --driver"),
        (["robot", BALANCE, "--driver", "unitree", "--host", "1.2.3.4"], "--host, --port: got ('1.2.3.4', 47800)"),
        (["robot", BALANCE, "--host", "203.0.113.7"], "address: got 203.0.113.7:47800; expected a free one of this"),
        (["live", BALANCE, "--no-browser", "--driver", "unitree"], "--robot: got none; expected that of --driver"),
        (["live", BALANCE, "--no-browser", "--port", "0", "--robot", "1.2.3"], "robot: got 1.2.3; expected host:port"),
    ],
)
def test_an_option_that_the_link_cannot_use_is_refused_at_once(
    arguments: list[object], words: str, invoke: Invoke, tmp_path: Path
) -> None:
    code, output = invoke(*arguments, *(["--out", tmp_path] if arguments[0] != "robot" else []))
    assert code == 2
    assert output.startswith(f"error: {words}"), output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["play", "plot"])
def test_a_run_that_does_not_exist_is_refused(command: str, invoke: Invoke, tmp_path: Path) -> None:
    code, output = invoke(command, "latest", "--runs", tmp_path)
    assert code == 2
    assert "no finished run" in output and "lgmpc run solo12_balance" in output
    code, output = invoke(command, "nothing", "--runs", tmp_path)
    assert code == 2
    assert "no run folder nothing" in output
    code, output = invoke(command, tmp_path)
    assert code == 2
    assert "is not a complete run folder: no config.yaml" in output
    assert_one_screen(output)


LONG_NAMES = {"name": "a" * 300, "path": "/".join(["b" * 100] * 50)}
LONG = {
    "check": ["check", "LONG"],
    "sweep": ["sweep", "LONG"],
    "play": ["play", "LONG"],
    "report": ["report", "LONG"],
    "compare": ["compare", "LONG", "LONG"],
    "out": ["run", BALANCE, "--out", "LONG"],
    "runs": ["explain", "latest", "--runs", "LONG"],
    "copy": ["configs", "--copy", "solo12_stand", "LONG"],
    "urdf": ["check", BALANCE, "robot.model=null", "robot.urdf=LONG"],
    "srdf": ["check", BALANCE, "robot.srdf=LONG"],
    "model": ["check", BALANCE, "robot.model=LONG"],
    "key": ["check", BALANCE, "LONG=1"],
    "name": ["check", BALANCE, "name=LONG"],
}


@pytest.mark.parametrize("length", LONG_NAMES)
@pytest.mark.parametrize("case", LONG)
def test_names_that_no_file_can_have_are_refused(
    case: str, length: str, invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, output = invoke(*(str(each).replace("LONG", LONG_NAMES[length]) for each in LONG[case]))
    assert code == 2
    assert output.startswith("error: ") and "internal error" not in output
    assert_one_screen(output)


def test_files_without_an_end_or_of_another_kind_are_refused(invoke: Invoke, tmp_path: Path) -> None:
    for command in ("check", "sweep"):
        code, output = invoke(command, "/dev/zero")
        assert (code, output.partition(";")[0]) == (2, "error: /dev/zero: got a device")
    large = tmp_path / "large.yaml"
    large.write_text("a: 1\n" * 400_000, encoding="utf-8")
    code, output = invoke("check", large)
    assert code == 2 and "large.yaml: got more than 262144 bytes" in output


def test_a_config_from_a_pipe_is_read(invoke: Invoke, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=(tmp_path / "pipe").write_bytes, args=(BALANCE.read_bytes(),))
    writer.start()
    code, _ = invoke("check", tmp_path / "pipe")
    writer.join()
    assert code == 0


def test_names_of_a_config_do_not_command_the_terminal(
    invoke: Invoke, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "red.yaml"
    config.write_text('"key\\e[31m": 1\nname: x\nrobot: {model: solo12, "key\\e[2J": 1}\n', encoding="utf-8")
    code, output = invoke("check", config)
    assert code == 2
    assert "\x1b" not in output and r"robot.key\x1b[2J" in output
    show_table(Table(("figure",), [("max\x1b]0;title\x07",)]))
    out().print(Text("a\x1b[1mb"), style="red")
    shown = capsys.readouterr().out
    assert "\x1b]" not in shown and r"max\x1b]0" in shown and r"a\x1b[1mb" in shown
