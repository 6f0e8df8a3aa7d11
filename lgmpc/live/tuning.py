"""The settings that a running controller reads anew: weights, gains, swings, footholds, timing of gaits.

All others act when something is built (horizons, limits of the QP, filters, the plant), and need a new run. A weight of
zero is not offered either: such a task is no part of the compiled whole-body QP.
"""

from collections.abc import Iterator
from typing import Any

from lgmpc.config.schema import Config
from lgmpc.control.legged import LeggedController
from lgmpc.errors import InputError
from lgmpc.locomotion.settings import gaits_of
from lgmpc.mpc import CentroidalMpc, CentroidalMpcSettings
from lgmpc.settings import Settings

_WEIGHTS = ("weights", "stepping_weights", "catching_weights")


def tunable_keys(config: Config, controller: LeggedController) -> Iterator[str]:
    """Yield the dotted keys of a config that :class:`Tuner` can change."""
    tasks = controller.wbc.tasks
    for name, task in tasks.items():
        if task.weight.any():
            sections = ("weights", "stepping_weights", "short_support_weights")
            used = sections[:2] if not controller.robot.short_support else sections
            yield from (f"wbc.{each}.{name}" for each in used if hasattr(getattr(config.wbc, each), name))
            gain = getattr(config.wbc.gains, name, None)
            if isinstance(gain, Settings):
                yield from (f"wbc.gains.{name}.{part}" for part, value in gain if value is not None)
            elif gain is not None:
                yield f"wbc.gains.{name}"
    yield "wbc.gains.stance_damping"
    if controller.planner is not None and isinstance(controller.planner.mpc, CentroidalMpc):
        yield from (f"mpc.{each}.{name}" for each in _WEIGHTS for name in type(getattr(config.mpc, each)).model_fields)
    for section in ("swing", "footholds"):
        settings = getattr(config.locomotion, section)
        yield from (f"locomotion.{section}.{name}" for name, value in settings if isinstance(value, float))
    for i in range(len(config.locomotion.gaits)):
        yield from (f"locomotion.gaits.{i}.{name}" for name in ("period_s", "duty"))


class Tuner:
    """Changes settings of a running controller, between two of its updates.

    Args:
        config: from which the controller was built.
        controller: the controller.

    Attributes:
        config: with all changes.
        keys: that can change.
    """

    def __init__(self, config: Config, controller: LeggedController) -> None:
        self._controller = controller
        gaits = controller.feet.gaits
        given = {gait.name for gait in config.locomotion.gaits}
        named = [gait for name, gait in gaits.items() if name not in given and not gait.stands]
        # Predefined gaits have no key of their own: as gaits of the config they have.
        self.config = config.replace(
            {
                "locomotion.gaits": (*config.locomotion.gaits, *named),
                "locomotion.swing.clearance_m": controller.feet.clearance,
            }
        )
        self.keys = tuple(dict.fromkeys(tunable_keys(self.config, controller)))

    @property
    def values(self) -> dict[str, Any]:
        """The present values by key."""
        return {key: self.config.value(key) for key in self.keys}

    def set(self, key: str, value: Any) -> Any:
        """Change a setting, and return its value as read from the controller.

        Raises:
            InputError: a key that cannot change, or a value that cannot be used.
        """
        if key not in self.keys:
            raise InputError("key", key, "a setting that can change while the controller runs", self.keys, word=key)
        self.config = config = self.config.replace({key: value})
        controller = self._controller
        section = key.partition(".")[0]
        if section == "wbc":
            controller.wbc.retune(config.wbc)
        elif section == "mpc":
            assert controller.planner is not None and isinstance(controller.planner.mpc, CentroidalMpc)
            assert isinstance(config.mpc, CentroidalMpcSettings)
            controller.planner.mpc.retune(config.mpc)
        else:
            controller.feet.retune(config.locomotion, gaits_of(controller.robot, config.locomotion))
        return self._read(key)

    def _read(self, key: str) -> Any:
        """Return a value as the controller has it."""
        section, _, rest = key.partition(".")
        controller = self._controller
        if section == "mpc":
            assert controller.planner is not None
            return controller.planner.mpc.settings.value(rest)
        return (controller.wbc.settings if section == "wbc" else controller.feet.settings).value(rest)
