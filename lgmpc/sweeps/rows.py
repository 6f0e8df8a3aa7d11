"""The record of a finished point: one line of JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any

from lgmpc.errors import RunFolderError
from lgmpc.runs.atomic import json_values

__all__ = ["Ending", "Row"]


class Ending(str, Enum):
    """The ending of a point."""

    PASS = "pass"
    """It passed its gate, or its boundary was found."""
    FAIL = "fail"
    """It failed its gate."""
    UNBRACKETED = "unbracketed"
    """Both ends of its bisection have the same verdict."""
    RAISED = "raised"
    """It raised an error."""
    HUNG = "hung"
    """It exceeded the sweep's time limit."""
    DIED = "died"
    """Its process ended: killed, out of memory, or crashed in native code."""

    @property
    def computed(self) -> bool:
        """Whether there is a verdict."""
        return self in (Ending.PASS, Ending.FAIL)


@dataclass(frozen=True)
class Row:
    """A finished point.

    Attributes:
        key: key of the point.
        ending: its ending.
        reasons: reasons why it did not pass.
        metrics: the kept metrics by name; ``None`` where there was nothing to measure.
        boundary: result of its bisection; ``None`` if there was none or it found no boundary.
        trials: values that the bisection tried, and whether each passed.
        violations: values below the boundary at which it failed.
        simulated_s: simulated time, s.
        elapsed_s: computing time in its process, s.
        log: name of its run folder among the sweep's logs, which may have been removed for that of a failure; empty if
            it was not kept.
        base: as in :class:`lgmpc.sweeps.design.Point`, and so are the next three.
        variant: name of the variant.
        levels: value of each factor and draw.
        draw: number of the draw.
    """

    key: str
    ending: Ending
    reasons: tuple[str, ...] = ()
    metrics: Mapping[str, float | None] = field(default_factory=dict)
    boundary: float | None = None
    trials: tuple[tuple[float, bool], ...] = ()
    violations: tuple[float, ...] = ()
    simulated_s: float = 0.0
    elapsed_s: float = 0.0
    log: str = ""
    base: str = ""
    variant: str = ""
    levels: Mapping[str, Any] = field(default_factory=dict)
    draw: int | None = None

    @property
    def passed(self) -> bool:
        """Whether the run passed."""
        return self.ending is Ending.PASS

    def to_json(self) -> str:
        """Return the row as one line of JSON."""
        content = asdict(self)
        content["metrics"] = json_values(self.metrics)
        return json.dumps(content, allow_nan=False)

    @classmethod
    def from_json(cls, line: str, source: str) -> Row:
        """Read a line; ``source`` names it in errors.

        Raises:
            RunFolderError: if it is not a row.
        """
        try:
            content = json.loads(line)
            values = {each.name: content[each.name] for each in fields(cls)}
            values["ending"] = Ending(values["ending"])
            for name in ("reasons", "violations"):
                values[name] = tuple(values[name])
            values["trials"] = tuple((float(value), bool(passed)) for value, passed in values["trials"])
            return cls(**values)
        except (ValueError, KeyError, TypeError) as error:
            raise RunFolderError(f"{source} is not a row of a sweep: {type(error).__name__} {error}") from error
