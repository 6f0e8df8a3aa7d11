"""Help, versions, checks, schema: what the command line says without simulating."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from lgmpc import __version__
from lgmpc.cli.app import app

from .conftest import BALANCE, ROOT, Invoke

HEAVY = ("numpy", "casadi", "pinocchio", "mujoco", "proxsuite", "pydantic", "yaml", "matplotlib", "meshcat")


def test_help_needs_nothing_heavy() -> None:
    code = "import sys, lgmpc.cli.app, lgmpc.cli; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "typer" in loaded
    assert not set(HEAVY) & set(loaded)


@pytest.mark.parametrize("command", [[], ["run"], ["play"], ["plot"], ["check"], ["doctor"], ["schema"]], ids=str)
def test_every_command_explains_itself(command: list[str], invoke: Invoke) -> None:
    code, output = invoke(*command, "--help")
    assert code == 0
    assert "Usage:" in output
    assert invoke(*command, "-h") == (0, output)


def test_help_shows_examples_and_exit_codes(invoke: Invoke) -> None:
    assert "lgmpc run configs/solo12_balance.yaml" in invoke("--help")[1]
    assert "130 stopped by Ctrl-C" in invoke("--help")[1]
    assert "--set mpc.enabled=false" in invoke("run", "--help")[1]


def test_commands_in_help_and_readme_exist(invoke: Invoke) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    listed = {line.split("`")[1].split()[1] for line in readme.splitlines() if line.startswith("| `lgmpc ")}
    assert listed == {command.name or command.callback.__name__ for command in app.registered_commands}
    for command in listed:
        assert f"lgmpc {command}" in invoke(command, "--help")[1].partition("Examples")[2]


def test_the_version_is_the_packages(invoke: Invoke) -> None:
    assert invoke("--version") == (0, f"lgmpc {__version__}\n")


def test_check_says_what_a_config_means(invoke: Invoke) -> None:
    code, output = invoke("check", BALANCE)
    assert code == 0
    for words in (
        "solo12, 2.500 kg, free base, 12 joints",
        "FL_FOOT, FR_FOOT",
        "20 nodes of 20 ms",
        "2 N.s in 0.2 s (10 N)",
        "OK",
    ):
        assert words in output
    assert "note:" not in output


def test_check_tells_what_was_probably_not_meant(invoke: Invoke) -> None:
    code, output = invoke("check", BALANCE, "duration_s=5", "--set", "mpc.enabled=false")
    assert code == 0
    assert "note: pushes.2 begins at 7 s, after the end of the run (5 s)" in output
    assert "mpc        off" in output


def test_the_schema_goes_to_stdout_or_a_file(invoke: Invoke, tmp_path: Path) -> None:
    code, output = invoke("schema")
    assert code == 0
    kinds = json.loads(output)["$defs"]
    assert kinds["Config"]["properties"]["duration_s"]["description"] == "Simulated time, s."
    assert "problem" in kinds["SolveConfig"]["required"]
    file = tmp_path / "schema.json"
    assert invoke("schema", "--out", file) == (0, "")
    assert file.read_text(encoding="utf-8") == output


def test_a_reader_that_stops_reading_is_no_error() -> None:
    command = f"set -o pipefail; {sys.executable} -m lgmpc schema | true"
    finished = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert finished.stderr == ""
    assert finished.returncode == 0
