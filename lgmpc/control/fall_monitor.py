"""When balancing is given up (tilt, height, contacts, tracking, solvers that fail), and when it may begin again."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from lgmpc.settings import Fraction, Positive, Settings
from lgmpc.typing import Array

__all__ = ["FallMonitor", "FallSettings", "RestMonitor"]


class FallSettings(Settings):
    """Limits beyond which a robot gives up: no torque, joints damped."""

    tilt_deg: Annotated[Positive, Field(le=180.0)] = Field(
        default=60.0, description="Tilt of the base at which balancing ends at once, degrees."
    )
    height_share: Fraction = Field(
        default=0.5,
        description="Height of the centre of mass above the feet, as a share of that of standing, at least.",
    )
    low_s: Positive = Field(default=0.1, description="How long it may be lower than that, s.")
    height_error_share: Positive = Field(
        default=0.4, description="Largest error of the height, as a share of the height of standing."
    )
    tilt_error_deg: Positive = Field(default=40.0, description="Largest tilt that is still being corrected, degrees.")
    tracking_s: Positive = Field(default=0.2, description="How long height and tilt may be further off than that, s.")
    unsupported_s: Positive = Field(default=0.25, description="How long no foot may measure a contact, s.")
    failing_s: Positive = Field(
        default=0.1, description="How long the whole-body controller may be without a solution, s."
    )


class FallMonitor:
    """Compares what is measured with the limits, each over a time of its own.

    Args:
        settings: see :class:`FallSettings`.
        height: of the centre of mass above the feet of the standing robot, m.
    """

    def __init__(self, settings: FallSettings, height: float) -> None:
        self._settings = s = settings
        self._tilt, self._tilted = math.cos(math.radians(s.tilt_deg)), math.cos(math.radians(s.tilt_error_deg))
        self._lowest, self._error = s.height_share * height, s.height_error_share * height
        self._low = self._off = self._unsupported = self._failing = math.inf  # since when, s

    def reset(self) -> None:
        """Forget what was measured."""
        self._low = self._off = self._unsupported = self._failing = math.inf

    def tilted(self, upright: float) -> str:
        """Return why a robot with the cosine ``upright`` of its tilt cannot balance; empty if it can."""
        return f"tilted by more than {self._settings.tilt_deg:g} degrees" if upright < self._tilt else ""

    def update(self, t: float, upright: float, error: float, solved: bool) -> str:
        """Return why a robot that rises, stands or lies down is to give up; empty while it is not.

        Args:
            t: time, s.
            upright: cosine of the tilt.
            error: of the height of the centre of mass, m.
            solved: whether the whole-body controller had a solution at the last tick.
        """
        s = self._settings
        off = abs(error) > self._error or upright < self._tilted
        self._off = min(self._off, t) if off else math.inf
        self._failing = math.inf if solved else min(self._failing, t)
        if t - self._off >= s.tracking_s:
            return "height or tilt could not be held"
        if t - self._failing >= s.failing_s:
            return "the whole-body controller has no solution"
        return self.tilted(upright)

    def update_support(self, t: float, height: float, touching: bool) -> str:
        """Return why a robot that stands or walks is to give up; empty while it is not.

        Args:
            t: time, s.
            height: of the centre of mass above the feet, m.
            touching: whether any foot measures a contact, or none can.
        """
        s = self._settings
        self._low = min(self._low, t) if height < self._lowest else math.inf
        self._unsupported = math.inf if touching else min(self._unsupported, t)
        if t - self._low >= s.low_s:
            return f"lower than {100.0 * s.height_share:g} % of its height"
        if t - self._unsupported >= s.unsupported_s:
            return f"no foot on the ground for {s.unsupported_s:g} s"
        return ""


class RestMonitor:
    """When a damped robot may move again: it lies still on its belly, and is allowed to.

    Args:
        rest_s: how long it lies still before, s.
        automatic: whether lying still suffices; else the request has to change after the robot was damped.
    """

    _UPRIGHT = math.cos(math.radians(20.0))
    _SPEED = 0.1  # m/s and rad/s of the base
    _RATE = 1.0  # rad/s of all joints

    def __init__(self, rest_s: float, automatic: bool) -> None:
        self._rest, self._automatic = rest_s, automatic
        self._request, self._changed = "", automatic
        self._still = math.inf

    def begin(self, request: str) -> None:
        """Begin to watch a robot that was damped under ``request``."""
        self._request, self._changed = request, self._automatic
        self._still = math.inf

    def update(self, t: float, upright: float, v: Array, request: str) -> bool:
        """Return whether the robot may move again.

        Args:
            t: time, s.
            upright: cosine of the tilt.
            v: (nv,) velocity, the base's first.
            request: the commanded mode.
        """
        self._changed = self._changed or request != self._request
        base, joints = v[:6], v[6:]
        still = upright > self._UPRIGHT and base @ base < self._SPEED**2 and joints @ joints < self._RATE**2
        self._still = min(self._still, t) if still else math.inf
        return self._changed and t - self._still >= self._rest
