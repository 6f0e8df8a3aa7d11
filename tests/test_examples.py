"""The examples of ``scripts/`` run and reach their targets."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).parent.parent / "scripts"


@pytest.mark.slow
def test_optimise_com_circle() -> None:
    spec = importlib.util.spec_from_file_location("optimise_com_circle", SCRIPTS / "optimise_com_circle.py")
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    solution, error = example.solve()
    assert solution.status.name == "CONVERGED", solution.explain()
    assert np.abs(solution.defects()).max() < 1e-9
    assert error.max() < 0.002  # measured 1.1 mm, with the cost of effort
    assert np.abs(solution.us).max() < 1.8  # unconstrained here, yet within the motors' reach
