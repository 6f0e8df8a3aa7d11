"""``lgmpc configs``, and configs by name in the commands that take one."""

import itertools
from pathlib import Path

import pytest

from lgmpc.config import load_config
from lgmpc.shipped import shipped_configs, shipped_sweeps

from .conftest import Invoke


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_configs_are_listed_one_a_line(invoke: Invoke) -> None:
    code, output = invoke("configs")
    assert code == 0
    *lines, hint = output.splitlines()
    configs, sweeps = (list(part) for filled, part in itertools.groupby(lines, bool) if filled)  # lists with a gap
    for part, shipped in ((configs, shipped_configs()), (sweeps, shipped_sweeps())):
        assert [line.split()[:2] for line in part] == [[name, each.command] for name, each in shipped.items()]
    assert hint.startswith("next: ")


def test_commands_take_a_name(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    assert invoke("check", "solo12_stand")[0] == 0
    code, output = invoke("run", "solo12_stand", "duration_s=0.5", "--quiet")
    assert (code, output.split()[0]) == (0, "PASS")
    monkeypatch.setenv("LGMPC_JIT", "0")  # a few iterations: less than compiling takes
    code, output = invoke("solve", "panda_reach", "--quiet")
    assert (code, output.split()[0]) == (0, "PASS")


def test_the_wrong_command_for_a_name_names_the_right_one(invoke: Invoke) -> None:
    code, output = invoke("run", "panda_reach")
    assert code == 2
    assert "lgmpc solve " in output


def test_a_copy_goes_where_it_should_and_says_what_is_next(invoke: Invoke) -> None:
    code, output = invoke("configs", "--copy", "solo12_stand")
    assert (code, output) == (0, "wrote solo12_stand.yaml\nnext: lgmpc run solo12_stand.yaml\n")
    Path("a folder").mkdir()
    assert "next: lgmpc solve 'a folder/panda_reach.yaml'" in invoke("configs", "--copy", "panda_reach", "a folder")[1]
    assert invoke("configs", "--copy", "solo12_stand", "mine.yaml")[0] == 0
    assert load_config("mine.yaml") == load_config("solo12_stand")


def test_a_copy_replaces_nothing_unless_forced(invoke: Invoke) -> None:
    mine = Path("mine.yaml")
    mine.write_text("mine", encoding="utf-8")
    code, output = invoke("configs", "--copy", "solo12_stand", mine)
    assert code == 2
    assert "--force" in output
    assert mine.read_text(encoding="utf-8") == "mine"
    assert invoke("configs", "--copy", "solo12_stand", mine, "--force")[0] == 0
    assert load_config(mine).name == "solo12_stand"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--copy", "solo12_stnd"], "Did you mean solo12_stand"),
        (["--copy", "solo12_stand", "nowhere/mine.yaml"], "nowhere/mine.yaml"),
        (["mine.yaml"], "--copy: got nothing"),
        (["--force"], "--copy: got nothing"),
    ],
    ids=str,
)
def test_bad_arguments_write_nothing(arguments: list[str], message: str, invoke: Invoke) -> None:
    code, output = invoke("configs", *arguments)
    assert code == 2
    assert message in output
    assert list(Path().iterdir()) == []
