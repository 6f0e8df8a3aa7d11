"""A small valid config, and the folder of the shipped ones."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

SMALL = """\
name: small
robot:
  model: solo12
  contact_frames: [FL_FOOT, FR_FOOT, HL_FOOT, HR_FOOT]
  effort_limit_nm: 1.8
pushes:
  - {body: base_link, time_s: 2.0, impulse_ns: [0, 2, 0]}
"""


@pytest.fixture
def small() -> str:
    return SMALL


@pytest.fixture
def small_file(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    return path


SHIPPED = sorted((ROOT / "configs").glob("*.yaml"))
PROBLEMS = [path for path in SHIPPED if "\nproblem:" in path.read_text(encoding="utf-8")]


@pytest.fixture(params=SHIPPED, ids=lambda path: path.stem)
def shipped(request: pytest.FixtureRequest) -> Path:
    """Every config in the repository."""
    path: Path = request.param
    return path


@pytest.fixture(params=[path for path in SHIPPED if path not in PROBLEMS], ids=lambda path: path.stem)
def shipped_run(request: pytest.FixtureRequest) -> Path:
    """Every config of a closed loop."""
    path: Path = request.param
    return path


@pytest.fixture(params=PROBLEMS, ids=lambda path: path.stem)
def shipped_problem(request: pytest.FixtureRequest) -> Path:
    """Every config of a problem to solve."""
    path: Path = request.param
    return path
