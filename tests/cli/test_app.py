"""Help, versions, checks, completion, schema: what the command line prints without simulating."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from lgmpc import __version__
from lgmpc.cli.app import app

from .conftest import BALANCE, ROOT, STAND, Invoke, Result

HEAVY = ("numpy", "casadi", "pinocchio", "mujoco", "proxsuite", "pydantic", "yaml", "matplotlib", "meshcat")


def test_help_imports_no_large_package() -> None:
    code = """
import atexit, sys
atexit.register(lambda: print(*sys.modules, file=sys.stderr))
sys.argv = ["lgmpc", "--help"]
from lgmpc.cli import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.split())
    assert "Usage:" in done.stdout and "typer" in loaded
    assert not set(HEAVY) & loaded


def test_no_arguments_print_the_help(result: Result) -> None:
    bare, asked = result(), result("--help")
    assert (bare.returncode, bare.stderr) == (0, "")
    assert bare.stdout == asked.stdout


def test_a_path_is_printed_in_its_own_bytes_in_an_ascii_locale(result: Result, tmp_path: Path) -> None:
    folder = tmp_path / "st\u00e4nde"
    folder.mkdir()
    file = folder / "st\u00e4nd.yaml"
    file.write_bytes(STAND.read_bytes())
    ascii_locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    missing = result("check", folder / "stand.yaml", **ascii_locale)
    assert missing.returncode == 2
    assert f"Did you mean {file}" in missing.stderr
    ran = result("run", file, "duration_s=0.1", "mpc.enabled=false", "gate={}", "--out", folder, **ascii_locale)
    assert ran.returncode == 0, ran.stderr
    assert f"saved in {folder}/" in ran.stdout


def test_text_that_stdout_cannot_encode_is_escaped(result: Result, tmp_path: Path) -> None:
    file = tmp_path / "st\u00e4nd.yaml"
    copied = result("configs", "--copy", "solo12_stand", file, PYTHONIOENCODING="ascii")
    assert copied.returncode == 0, copied.stderr
    assert file.is_file()
    assert copied.stdout.startswith(f"wrote {tmp_path}/st\\xe4nd.yaml\n")


def test_the_next_line_can_be_pasted_into_a_shell(invoke: Invoke, tmp_path: Path) -> None:
    _, output = invoke("run", STAND, "duration_s=0.1", "mpc.enabled=false", "--out", tmp_path / "my runs")
    folder = next((tmp_path / "my runs").iterdir())
    assert f"next: lgmpc play '{folder}' " in output
    assert f"lgmpc plot '{folder}' " in output


def _complete(result: Result, *words: str) -> list[str]:
    """Return bash's completions of the last of ``words``."""
    line = {"_LGMPC_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(words), "COMP_CWORD": str(len(words) - 1)}
    return result(**line).stdout.split()


def test_the_shell_completes_configs_runs_and_demos(result: Result, tmp_path: Path) -> None:
    assert _complete(result, "lgmpc", "check", "solo12_st") == [
        "solo12_stairs",
        "solo12_stairs_map",
        "solo12_stand",
        "solo12_step_recovery",
        "solo12_stones",
        "solo12_strong_push",
    ]
    assert _complete(result, "lgmpc", "run", "mine") == []  # the shell then completes file names
    assert _complete(result, "lgmpc", "demo", "dzh") == ["dzhanibekov"]
    assert _complete(result, "lgmpc", "play", "") == ["latest"]
    for folder, name in (
        ("runs", "20260101T000000Z-a"),
        ("runs", "20270101T000000Z-b"),
        ("other", "20280101T000000Z-c"),
    ):
        (tmp_path / folder / name).mkdir(parents=True)
        (tmp_path / folder / name / "run.json").write_text("{}", encoding="utf-8")
    assert _complete(result, "lgmpc", "play", "") == ["latest", "20270101T000000Z-b", "20260101T000000Z-a"]
    assert _complete(result, "lgmpc", "plot", "--runs", "other", "2") == ["20280101T000000Z-c"]
    assert _complete(result, "lgmpc", "configs", "--copy", "panda") == ["panda_reach"]


@pytest.mark.parametrize(
    "command", [[], ["run"], ["play"], ["plot"], ["check"], ["configs"], ["doctor"], ["schema"]], ids=str
)
def test_every_command_has_help(command: list[str], invoke: Invoke) -> None:
    code, output = invoke(*command, "--help")
    assert code == 0
    assert "Usage:" in output
    assert invoke(*command, "-h") == (0, output)


def test_help_shows_examples_and_exit_codes(invoke: Invoke) -> None:
    assert "lgmpc run solo12_balance" in invoke("--help")[1]
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


def test_check_shows_what_a_config_means(invoke: Invoke) -> None:
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


def test_check_notes_probable_mistakes(invoke: Invoke) -> None:
    code, output = invoke("check", BALANCE, "duration_s=5", "--set", "mpc.enabled=false")
    assert code == 0
    assert "note: pushes.2 begins at 7 s, after the end of the run (5 s)" in output
    assert "mpc        off" in output


def test_the_schema_goes_to_stdout(invoke: Invoke) -> None:
    code, output = invoke("schema")
    assert code == 0
    kinds = json.loads(output)["$defs"]
    assert kinds["Config"]["properties"]["duration_s"]["description"] == "Simulated time, s."
    assert "problem" in kinds["SolveConfig"]["required"]


@pytest.mark.parametrize("output", ["schema", "configs"])  # in one write, and by lines
def test_a_closed_pipe_is_no_error(output: str) -> None:
    command = f"set -o pipefail; {sys.executable} -m lgmpc {output} | true"
    finished = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert finished.stderr == ""
    assert finished.returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_device_as_output_is_one_error() -> None:
    finished = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m lgmpc configs > /dev/full"], capture_output=True, text=True
    )
    assert finished.stderr == "error: the output cannot be used: no space left on device\n"
    assert finished.returncode == 2
