"""Controls that are made from data: a slider for each setting that can change, and the worlds of a new run."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import annotated_types
import viser
from pydantic.fields import FieldInfo

from lgmpc.config.schema import Config
from lgmpc.live.wishes import Tune
from lgmpc.settings import LARGEST

_WORLDS = {
    "floor": "floor", "slope up": "slope_10deg", "slope across": "slope_across_10deg", "stairs": "stairs_{:.0f}mm",
    "stairs over": "stairs_over_{:.0f}mm", "blocks": "blocks_{:.0f}mm", "hills": "hills_{:.0f}mm",
    "slippery": "patches",
}  # fmt: skip
_RISE, _MOST = 120.0, 4.0
"""Steps and blocks, mm per metre of the robot's height; largest value on a slider, in units of the present one."""


def add_worlds(gui: viser.GuiApi, height: float, restart: Callable[[str], None]) -> None:
    """Add the choice of the ground of a new run, for a robot of some height, m."""
    names = {"as it is": "", **{label: name.format(_RISE * height) for label, name in _WORLDS.items()}}
    world = gui.add_dropdown("world", tuple(names))
    gui.add_button("Restart", hint="a new run").on_click(lambda _: restart(names[world.value]))


class SettingControls:
    """A slider for each setting, or three numbers for a vector, in folders by section.

    Args:
        gui: viser's.
        tab: where they are added, in place of those of the run before.
        config: whose fields have bounds and descriptions.
        values: present values by dotted key.
        ask: called with what the user changes.
    """

    def __init__(
        self, gui: viser.GuiApi, tab: Any, config: Config, values: Mapping[str, Any], ask: Callable[[Tune], None]
    ) -> None:
        self._gui, self._config, self._ask = gui, config, ask
        for child in list(tab._children.values()):
            child.remove()
        with tab:
            self._told = gui.add_markdown("Values act at once; they are those of the config's keys.")
        sections: dict[str, list[str]] = {}
        for key in values:
            sections.setdefault(_section(key), []).append(key)
        for section, keys in sections.items():
            with tab, gui.add_folder(_title(section, config), expand_by_default=False):
                for key in keys:
                    self._add(key, key.removeprefix(f"{section}."), values[key])

    def confirm(self, key: str, value: Any) -> None:
        """Show the value that the controller has."""
        self._told.content = f"`{key}` is {value} in the controller."

    def _add(self, key: str, label: str, value: Any) -> None:
        field, ask = field_of(self._config, key), self._ask
        if isinstance(value, tuple):
            handle: Any = self._gui.add_vector3(label, value, min=(0.0, 0.0, 0.0), hint=field.description)
            handle.on_update(lambda _: ask(Tune(key, tuple(map(float, handle.value)))))
            return
        low, high = bounds_of(field)
        high = _nice(_MOST * max(value, 1e-3)) if high is None else high
        low = min(0.0, value) if low is None else low
        step = _nice((high - low) / 400.0)
        handle = self._gui.add_slider(label, low, high, step, value, hint=field.description)
        handle.on_update(lambda _: ask(Tune(key, float(handle.value))))


def _section(key: str) -> str:
    """Return the beginning of a key that names its section: two levels, of gaits three."""
    parts = key.split(".")
    return ".".join(parts[: 3 if parts[1] == "gaits" else 2])


def _title(section: str, config: Config) -> str:
    """Return the title of a section's folder: its key, and the name of a gait."""
    number = section.removeprefix("locomotion.gaits.")
    return f"gait {config.locomotion.gaits[int(number)].name}" if number.isdecimal() else section


def _nice(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten near a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{min((1.0, 2.0, 5.0, 10.0), key=lambda each: abs(each * power - value)) * power:.3g}")


def field_of(config: Config, key: str) -> FieldInfo:
    """Return the field of a dotted key."""
    section, _, name = key.rpartition(".")
    return type(config.value(section)).model_fields[name]


def bounds_of(field: FieldInfo) -> tuple[float | None, float | None]:
    """Return the lowest and the highest value of a field, None where it has none of its own."""
    low: float | None = None
    high: float | None = None
    for each in field.metadata:
        if isinstance(each, (annotated_types.Ge, annotated_types.Gt)):
            low = float(each.ge if isinstance(each, annotated_types.Ge) else each.gt)  # type: ignore[arg-type]
        elif isinstance(each, (annotated_types.Le, annotated_types.Lt)):
            high = float(each.le if isinstance(each, annotated_types.Le) else each.lt)  # type: ignore[arg-type]
    return (None if low is None or low < -LARGEST / 2 else low), (None if high is None or high > LARGEST / 2 else high)
