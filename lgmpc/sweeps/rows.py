"""What a finished point leaves: one line of JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any

from lgmpc.errors import RunFolderError

__all__ = ["Ending", "Row"]


class Ending(str, Enum):
    """How a point ended."""

    PASS = "pass"
    """It passed its gate, or its boundary was found."""
    FAIL = "fail"
    """It broke its gate."""
    UNBRACKETED = "unbracketed"
    """Both ends of its bisection agree."""
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
        key: of the point.
        ending: how it ended.
        reasons: why it did not pass.
        metrics: the kept metrics, by name; ``None`` where there was nothing to measure.
        boundary: what its bisection found; ``None`` if there was none or it found none.
        trials: values that the bisection tried, and whether each passed.
        violations: values below the boundary at which it failed.
        simulated_s: simulated time.
        elapsed_s: time that it took in its process, s.
        log: name of its run folder among the sweep's logs, which may have made room for a failure's since; empty if
            none was kept.
        base: as in :class:`lgmpc.sweeps.design.Point`, and so are the next three.
        variant: name.
        levels: values.
        draw: number.
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
        """Whether it passed."""
        return self.ending is Ending.PASS

    def to_json(self) -> str:
        """Return it as one line."""
        content = asdict(self)
        content["metrics"] = {
            name: None if value is None or not math.isfinite(value) else value for name, value in self.metrics.items()
        }
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
            raise RunFolderError(f"{source} is no row of a sweep: {type(error).__name__} {error}") from error
