"""The problems that come with lgmpc pass their own gates."""

from pathlib import Path

import pytest

from .conftest import Invoke

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(
    "name",
    [
        "upside_down_recovery",
        pytest.param("talos_reach", marks=pytest.mark.slow),
        pytest.param("solo12_righting", marks=pytest.mark.slow),
    ],
)
def test_passes_its_gate(invoke: Invoke, tmp_path: Path, name: str) -> None:
    code, output = invoke("solve", CONFIGS / f"{name}.yaml", "--out", tmp_path / "runs", "--quiet")
    assert (code, output) == (0, f"PASS  {name}\n"), output


def test_a_quadrotor_too_heavy_for_its_rotors_is_refused_by_key(invoke: Invoke, tmp_path: Path) -> None:
    code, output = invoke("solve", CONFIGS / "iris_loop.yaml", "--set", "problem.rotors.max_thrust_n=3.0")
    assert code == 2 and "problem.rotors.max_thrust_n: got 3.0; expected above 3.76 N" in output
