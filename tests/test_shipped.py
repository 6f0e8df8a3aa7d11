"""Shipped configs: found by name, described in a line, copied for editing."""

from pathlib import Path

import pytest

from lgmpc import shipped
from lgmpc.config import load_any_config, load_config, load_solve_config
from lgmpc.errors import ConfigError

ROOT = Path(__file__).resolve().parents[1]
NAMES = sorted(file.stem for file in (ROOT / "configs").glob("*.yaml"))


def test_every_config_of_the_clone_is_shipped() -> None:
    assert "solo12_balance" in NAMES
    assert list(shipped.shipped_configs()) == NAMES


def test_an_installed_package_has_its_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "mine.yaml").write_text("# One. Two.\nname: mine\n", encoding="utf-8")
    monkeypatch.setattr(shipped, "_PACKAGE", tmp_path)
    assert list(shipped.shipped_configs()) == ["mine"]
    assert shipped.shipped_config("mine").summary == "One."


@pytest.mark.parametrize("name", NAMES)
def test_each_has_a_summary_of_one_line_and_its_command(name: str) -> None:
    config = shipped.shipped_config(name)
    assert 40 < len(config.summary) < 125
    assert config.summary.endswith(".") and "\n" not in config.summary
    assert f"#   lgmpc {config.command} configs/{name}.yaml\n" in config.text


def test_a_name_loads_the_shipped_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_config("solo12_balance") == load_config(ROOT / "configs" / "solo12_balance.yaml")
    assert load_solve_config("panda_reach", ["solver.method=sqp"]).solver.method == "sqp"
    assert load_any_config("solo12_stand").source.file == str(ROOT / "configs" / "solo12_stand.yaml")


def test_a_file_of_that_name_goes_first_and_a_folder_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "solo12_balance").mkdir()
    assert load_config("solo12_balance").name == "solo12_balance"
    (tmp_path / "solo12_stand").write_text("[]", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"^solo12_stand: "):
        load_config("solo12_stand")


def test_an_unknown_name_gets_the_nearest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"shipped config .*Did you mean solo12_stand\b") as caught:
        load_config("solo12_stnd")
    assert set(NAMES) <= set(caught.value.choices)
    with pytest.raises(ConfigError, match=r"Did you mean solo12_stand\b"):
        load_config("configs/solo12_stand.yaml")
    with pytest.raises(ConfigError, match=r"Did you mean panda_reach\?"):
        shipped.shipped_config("panda")


def test_a_copy_is_the_same_config_with_a_schema_that_editors_find(tmp_path: Path) -> None:
    config = shipped.shipped_config("solo12_balance")
    copy = tmp_path / "mine.yaml"
    copy.write_text(config.copy_text(), encoding="utf-8")
    assert load_config(copy) == load_config("solo12_balance")
    first = copy.read_text(encoding="utf-8").splitlines()[0]
    assert Path(first.partition("$schema=")[2]) == ROOT / "configs" / "schema.json"
