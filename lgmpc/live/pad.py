"""Keys that are held, gamepads, and sticks on the page: viser's client reports none of them.

A script on the page (``assets/pad.js``) sends what they ask for as the value of a hidden text, through the page's own
connection, so that all goes through one port. While anything is deflected it sends ten times a second: a page that
falls silent meanwhile, with its machine or its network, has let go.
"""

import html
import json
from collections.abc import Callable
from importlib import resources
from string import Template
from time import monotonic
from typing import Any

import viser

from lgmpc.live.wishes import Order

_SILENCE_S = 0.5
"""Time without a message after which what was deflected counts as released, s."""

Axes = tuple[float, float, float]
"""Ahead, left, and turn left, as shares of the largest velocities."""


class Pad:
    """The controls, in the present container of the page.

    Args:
        gui: viser's.
        moved: called with the deflections when they change.
        stepped: called with a direction, when a key is pressed that shall not be held.
        ordered: called with what a key or button orders.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        moved: Callable[[Axes], None],
        stepped: Callable[[Axes], None],
        ordered: Callable[[Order], None],
    ) -> None:
        self._moved, self._stepped, self._ordered = moved, stepped, ordered
        self._axes: Axes = (0.0, 0.0, 0.0)
        self._heard = monotonic()
        assets = resources.files("lgmpc.live") / "assets"
        self._text = gui.add_text("pad", "", visible=False)
        script = Template((assets / "pad.js").read_text("utf-8")).substitute(target=self._text._impl.uuid)
        gui.add_html(Template((assets / "pad.html").read_text("utf-8")).substitute(script=html.escape(script)))
        self._text.on_update(self._hear)

    def watch(self) -> None:
        """Let go where the page has fallen silent."""
        if any(self._axes) and monotonic() - self._heard > _SILENCE_S:
            self._move((0.0, 0.0, 0.0))

    async def _hear(self, _: Any) -> None:  # one after the other, unlike plain functions
        self._heard, content = monotonic(), json.loads(self._text.value)
        if "order" in content:
            self._ordered(Order(content["order"]))
        elif "step" in content:
            self._stepped(_axes(content["step"]))
        else:
            self._move(_axes(content["move"]))

    def _move(self, axes: Axes) -> None:
        if axes != self._axes:
            self._axes = axes
            self._moved(axes)


def _axes(numbers: list[float]) -> Axes:
    ahead, left, turn = map(float, numbers)
    return ahead, left, turn
