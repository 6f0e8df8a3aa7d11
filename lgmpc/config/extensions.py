"""Classes and functions of one's own, named in a config: tasks of the whole-body QP, costs of the MPC.

A config only names them; their modules are imported when the closed loop is built, not when the config is read.
"""

import importlib
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lgmpc.config.schema import Config
from lgmpc.costs import CostItem, Residual
from lgmpc.errors import LgmpcError
from lgmpc.mpc.full_body import FullBodyMpcSettings, OwnCost
from lgmpc.robot import Robot
from lgmpc.settings import Extension
from lgmpc.wbc import SymbolicTask, Task
from lgmpc.wbc.settings import OwnTask


def own_tasks(config: Config, robot: Robot) -> list[Task]:
    """Return the tasks of section ``wbc.tasks``.

    Raises:
        ConfigError: see :func:`load_extension`; or what is called fails, or returns something else than a task.
    """
    return [_task(config, f"wbc.tasks.{i}", entry, robot) for i, entry in enumerate(config.wbc.tasks)]


def own_costs(config: Config, robot: Robot) -> list[CostItem]:
    """Return the costs of section ``mpc.costs``, named as their classes, in small letters; errors as own_tasks."""
    if not isinstance(config.mpc, FullBodyMpcSettings):
        return []
    return [_cost(config, f"mpc.costs.{i}", entry, robot) for i, entry in enumerate(config.mpc.costs)]


def _task(config: Config, key: str, entry: OwnTask, robot: Robot) -> Task:
    found = load_extension(config, key, entry.use)
    symbolic = isinstance(found, type) and issubclass(found, SymbolicTask)
    task = called(config, key, entry, found, *(() if symbolic else (robot,)), entry.gain, entry.weight)
    if not isinstance(task, Task):
        raise wrong(config, key, entry, task, "a task, such as a class derived from lgmpc.SymbolicTask")
    return task


def _cost(config: Config, key: str, entry: OwnCost, robot: Robot) -> CostItem:
    found = load_extension(config, key, entry.use)
    residual = isinstance(found, type) and issubclass(found, Residual)
    cost = called(config, key, entry, found, *(() if residual else (robot,)))
    if isinstance(cost, CostItem):
        return cost
    if not isinstance(cost, Residual):
        raise wrong(config, key, entry, cost, "a cost, such as a class derived from lgmpc.Residual")
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(cost).__name__).lower()
    return CostItem(name, cost, entry.weight)


def load_extension(config: Config, key: str, use: str) -> Any:
    """Return what ``module:name`` names.

    Args:
        config: the config, beside which the module may be.
        key: key of the name.
        use: the name.

    Raises:
        ConfigError: there is no such module, its import fails, or it has no such name.
    """
    module_name, _, name = use.partition(":")
    folders = list(dict.fromkeys([Path(config.source.file).parent.resolve(), Path.cwd()]))
    try:
        with _on_path(folders):
            module = importlib.import_module(module_name)
    except Exception as error:  # of any kind: of the module's own code
        if isinstance(error, ModuleNotFoundError) and f"{module_name}.".startswith(f"{error.name}."):
            expected = f"a module in {' or '.join(map(str, folders))}, or an installed one"
            choices = [file.stem for folder in folders for file in folder.glob("*.py")]
            raise config.error(key, f"no module '{error.name}'", expected, choices, word=module_name) from error
        got = f"{module_name}, whose import fails ({type(error).__name__}: {error})"
        raise config.error(key, got, "a module that can be imported") from error
    if not hasattr(module, name):
        choices = [each for each, value in vars(module).items() if callable(value) and not each.startswith("_")]
        raise config.error(key, f"no '{name}' in {module.__file__}", "a class or function", choices, word=name)
    return getattr(module, name)


@contextmanager
def _on_path(folders: list[Path]) -> Iterator[None]:
    before = list(sys.path)
    sys.path[:0] = [str(folder) for folder in folders]
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path[:] = before


def called(config: Config, key: str, entry: Extension, found: Callable[..., Any], *arguments: Any) -> Any:
    """Return what ``found``, named by ``entry``, returns.

    Raises:
        ConfigError: it fails.
    """
    try:
        return found(*arguments, **entry.arguments)
    except Exception as error:  # of any kind: of the user's own code
        words = str(error) if isinstance(error, LgmpcError) else f"{type(error).__name__}: {error}"
        expected = "what can be called with its arguments" if isinstance(error, TypeError) else "what can be built"
        raise config.error(key, f"{entry.use}, which fails ({words})", expected) from error


def wrong(config: Config, key: str, entry: Extension, value: object, expected: str) -> LgmpcError:
    """Return the error of a call that returned ``value``."""
    return config.error(key, f"{entry.use}, which returns {type(value).__name__}", expected)
