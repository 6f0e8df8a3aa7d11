"""Pushes: impulses on named bodies, distributed over the steps of a plant."""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated

import numpy as np
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.settings import NonNegative, Positive, Settings, Vector3, key
from lgmpc.typing import Array

_SNAP = 1e-6  # steps; a boundary closer to one of a step is rounded to it


class Push(Settings):
    """A constant force at a body's centre of mass, for a limited time."""

    body: str = Field(min_length=1, description="Name of the pushed body (link).")
    time_s: NonNegative = Field(description="Start of the push, s.")
    duration_s: Annotated[Positive, Field(le=3600.0)] = key(0.2, "Duration, s, at most an hour.")
    impulse_ns: Vector3 = Field(description="[x, y, z] force times duration, world axes, N.s.")

    @property
    def force(self) -> Array:
        """The (3,) force while it lasts, world axes, N."""
        return np.array(self.impulse_ns) / self.duration_s


class PushSchedule:
    """The pushes of one run, sampled at a plant's steps so that each gives exactly its impulse.

    A step that a push covers in part gets that part of its force, so the applied forces times ``dt`` add up to the
    impulse (to rounding) however the push lies between the steps.

    Args:
        pushes: in any order; they may overlap.
        dt: duration of the plant's steps, s.
        bodies: the bodies that the plant can push.

    Attributes:
        pushes: as given.
        bodies: names of the bodies that are pushed at some time, each once.

    Raises:
        InputError: if a push names a body that is not in ``bodies`` (names the nearest), or ``dt`` is not positive.
    """

    def __init__(self, pushes: Sequence[Push], dt: float, bodies: Sequence[str]) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise InputError("dt", dt, "a finite number of seconds above zero")
        for index, push in enumerate(pushes):
            if push.body not in bodies:
                name = f"pushes.{index}.body"
                raise InputError(name, repr(push.body), "a body of the robot", tuple(bodies), word=push.body)
        self.pushes = tuple(pushes)
        self.bodies = tuple(dict.fromkeys(push.body for push in pushes))
        self._dt = dt
        self._spans = [_span(push, dt) for push in pushes]
        self._edges = _edges(self._spans)
        self._at_rest = self._freeze({body: np.zeros(6) for body in self.bodies})

    def wrenches(self, time: float) -> Mapping[str, Array]:
        """Return the wrenches of the step that begins at ``time`` (a whole number of steps).

        Returns:
            For every pushed body, now or at another time, its (6,) wrench [force; torque] in world axes at its centre
            of mass; zero while it is not pushed. The arrays are read-only.
        """
        step = round(time / self._dt)
        active = [i for i, (begin, end) in enumerate(self._spans) if begin < step + 1 and step < end]
        if not active:
            return self._at_rest
        wrenches = {body: np.zeros(6) for body in self.bodies}
        for i in active:
            begin, end = self._spans[i]
            share = (min(step + 1.0, end) - max(float(step), begin)) / (end - begin)
            wrenches[self.pushes[i].body][:3] += np.array(self.pushes[i].impulse_ns) * (share / self._dt)
        return self._freeze(wrenches)

    def is_active(self, time: float) -> bool:
        """Return whether a body is pushed during the step that begins at ``time``."""
        return bisect_right(self._edges, round(time / self._dt)) % 2 == 1

    @staticmethod
    def _freeze(wrenches: dict[str, Array]) -> Mapping[str, Array]:
        for wrench in wrenches.values():
            wrench.flags.writeable = False
        return MappingProxyType(wrenches)


def _edges(spans: Sequence[tuple[float, float]]) -> list[int]:
    """Return the steps at which pushing begins and ends, in turn: the union of the spans."""
    edges: list[int] = []
    for begin, end in sorted((math.floor(begin), math.ceil(end)) for begin, end in spans):
        if edges and begin <= edges[-1]:
            edges[-1] = max(edges[-1], end)
        else:
            edges += [begin, end]
    return edges


def _span(push: Push, dt: float) -> tuple[float, float]:
    """Return begin and end of a push in steps, rounded to a step's boundary that is close."""
    begin, end = push.time_s / dt, (push.time_s + push.duration_s) / dt
    begin, end = (float(round(edge)) if abs(edge - round(edge)) < _SNAP else edge for edge in (begin, end))
    # A push whose duration is rounded to zero acts within one step, with its whole impulse.
    return (begin, end) if end > begin else (begin, begin + _SNAP)
