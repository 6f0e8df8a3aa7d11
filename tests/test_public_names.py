"""The names of ``import lgmpc``, and the modules that it loads."""

import importlib
import pkgutil
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from public_names import public_names

import lgmpc
from lgmpc.errors import InputError
from lgmpc.wbc import WholeBodySettings

NAMES = [name for name in lgmpc.__all__ if name != "__version__"]


def _run(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_what_its_module_exports(name: str) -> None:
    module = importlib.import_module(lgmpc._MODULE_OF[name])
    assert getattr(lgmpc, name) is getattr(module, name)
    assert name in public_names(lgmpc._MODULE_OF[name])
    assert getattr(lgmpc, name).__doc__


def test_the_product_comes_first_beside_the_optimiser() -> None:
    product = ["LeggedController", "Command", "Measurement", "RobotState", "MotionCommand", "World", "load_config"]
    assert NAMES[: len(product)] == product
    others = {"load_run", "run_sweep", "deploy", "SymbolicTask", "Gain", "Action", "Contact", "Fddp", "Residual"}
    assert others <= set(NAMES)
    assert len(NAMES) <= 60


def test_no_name_hides_a_package() -> None:
    assert not set(NAMES) & {room.name for room in pkgutil.iter_modules(lgmpc.__path__)}


def test_importing_the_package_loads_nothing_else() -> None:
    loaded = _run("import sys; before = set(sys.modules); import lgmpc; print(*set(sys.modules) - before)")
    allowed = {"lgmpc", "importlib", "typing", "warnings", "__future__"}  # and what these load
    own = [name for name in loaded if name.startswith("lgmpc.")]
    others = {name.partition(".")[0] for name in loaded} - set(sys.stdlib_module_names) - allowed
    assert (own, others) == ([], set())


def test_a_name_loads_its_own_room_only() -> None:
    loaded = _run("import sys, lgmpc; lgmpc.LgmpcError; print(*sys.modules)")
    assert "lgmpc.errors" in loaded
    assert not {"numpy", "pinocchio", "casadi", "lgmpc.config", "lgmpc.robot"} & set(loaded)


def test_dir_lists_the_names_and_no_others() -> None:
    assert _run("import lgmpc; print(*dir(lgmpc))") == sorted(lgmpc.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'lgmpc' has no attribute 'Fdpp'"):
        lgmpc.Fdpp  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'Fdpp'"):
        from lgmpc import Fdpp  # noqa: F401


@pytest.mark.parametrize(
    "wrong", [None, float("nan"), object(), np.zeros((3, 3))], ids=["None", "nan", "object", "array"]
)
@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lgmpc.load_config, "path"),
        (lgmpc.load_solve_config, "path"),
        (lgmpc.load_sweep, "path"),
        (lgmpc.run_sweep, "path"),
        (lgmpc.drive, "path"),
        (lgmpc.load_run, "run"),
        (lgmpc.show, "run"),
        (lgmpc.plot, "run"),
        (lgmpc.explain, "run"),
        (lgmpc.report, "run"),
        (lambda wrong: lgmpc.WholeBodyController(wrong, WholeBodySettings()), "robot"),
        (lambda wrong: lgmpc.CentroidalMpc(wrong, 4), "mass"),
    ],
)
def test_an_argument_of_a_wrong_type_is_named(call: Callable[[Any], object], argument: str, wrong: Any) -> None:
    with pytest.raises(InputError, match=f"^{argument}: "):
        call(wrong)
