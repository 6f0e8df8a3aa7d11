"""The package as it is installed: an editable clone, and a wheel outside the clone."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import venv
import zipfile
from email.parser import BytesParser
from pathlib import Path

import pytest
import yaml

import lgmpc
from lgmpc.shipped import shipped_configs, shipped_sweeps

ROOT = Path(__file__).resolve().parents[1]
BUILD_WHEEL = "import sys; from hatchling import build; print(build.build_wheel(sys.argv[1]))"


class Environment:
    """A virtual environment with lgmpc in it; dependencies come from the one that runs the tests, by their path."""

    def __init__(self, folder: Path, *install: object) -> None:
        venv.create(folder, with_pip=False, symlinks=True)
        self.python = folder / "bin" / "python"
        self.command = folder / "bin" / "lgmpc"
        site = sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)})
        # As a path of their own, their .pth files are not read: the lgmpc of this clone stays out.
        (Path(site) / "dependencies.pth").write_text("\n".join(_site_folders()) + "\n", encoding="utf-8")
        pip = [sys.executable, "-m", "pip", "--python", self.python, "install", "--quiet", "--no-deps", "--no-index"]
        subprocess.run([*pip, "--no-build-isolation", *map(str, install)], check=True)

    def run(self, *command: object, cwd: Path) -> "subprocess.CompletedProcess[str]":
        """Run a command without anything of this process's environment that could find the clone."""
        clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        command = tuple(map(str, command))
        return subprocess.run(command, cwd=cwd, env=clean, capture_output=True, encoding="utf-8", timeout=300)


def _site_folders() -> list[str]:
    """Folders of ``sys.path`` that hold installed packages."""
    return [entry for entry in sys.path if entry.endswith("site-packages")]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-c", BUILD_WHEEL, folder], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("*.whl"))


def test_version_and_date_are_the_same_everywhere() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    newest = re.search(r"^## \[(.*)\] - (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest is not None
    assert (citation["version"], str(citation["date-released"])) == newest.groups()
    assert citation["version"] == lgmpc.__version__


def test_the_wheel_carries_package_configs_assets_and_metadata(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        info = f"lgmpc-{lgmpc.__version__}.dist-info"
        metadata = BytesParser().parsebytes(archive.read(f"{info}/METADATA"))
    assert {name.split("/")[0] for name in names} == {"lgmpc", info}
    assert {f"lgmpc/configs/{name}.yaml" for name in shipped_configs()} <= names
    assert {f"lgmpc/configs/sweeps/{name}.yaml" for name in shipped_sweeps()} <= names
    assert {
        "lgmpc/configs/schema.json",
        "lgmpc/py.typed",
        "lgmpc/viz/assets/replay.js",
        f"{info}/licenses/LICENSE",
    } <= names
    assert not [name for name in names if name.endswith((".pyc", ".so", ".part"))]
    for suffix in (".py", ".pyi", ".c"):
        sources = {str(path.relative_to(ROOT)) for path in (ROOT / "lgmpc").rglob(f"*{suffix}")}
        assert {name for name in names if name.endswith(suffix)} == sources
    assert metadata["Version"] == lgmpc.__version__
    assert metadata["Author"] == "lgmpc developers"


def test_an_editable_clone_called_lgmpc_is_not_shadowed_by_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "lgmpc").symlink_to(ROOT)  # as `git clone` leaves it beside a script
    environment = Environment(tmp_path / "venv", "-e", tmp_path / "lgmpc")
    script = tmp_path / "script.py"
    script.write_text("import lgmpc, lgmpc.errors\nprint(lgmpc.__version__, lgmpc.__file__)\n", encoding="utf-8")
    for command in (["script.py"], ["-c", script.read_text(encoding="utf-8")]):
        done = environment.run(environment.python, *command, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert done.stdout.split() == [lgmpc.__version__, str(ROOT / "lgmpc" / "__init__.py")]


@pytest.mark.slow
def test_the_wheel_runs_the_main_job_by_name_outside_the_clone(wheel: Path, tmp_path: Path) -> None:
    environment = Environment(tmp_path / "venv", wheel)
    where = environment.run(environment.python, "-c", "import lgmpc; print(lgmpc.__file__)", cwd=tmp_path)
    assert Path(where.stdout.strip()).is_relative_to(tmp_path), where.stderr
    listed = environment.run(environment.command, "configs", cwd=tmp_path)
    names = {line.split()[0] for line in listed.stdout.splitlines() if line}
    assert names == {*shipped_configs(), *shipped_sweeps(), "next:"}, listed.stderr
    ran = environment.run(environment.command, "run", "solo12_balance", "--json", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    result = json.loads(ran.stdout)
    assert result["verdict"] == "pass"
    assert (tmp_path / result["folder"] / "log.npz").is_file()
