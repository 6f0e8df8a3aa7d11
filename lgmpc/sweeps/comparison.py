"""Two runs, or two sweeps, side by side, and whether the second one is worse beyond a margin."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from lgmpc.config.loading import parse_any_config
from lgmpc.config.schema import Config, SolveConfig
from lgmpc.errors import InputError, RunFolderError
from lgmpc.runs import Run, SolvedRun, load_run
from lgmpc.runs.atomic import json_values
from lgmpc.runs.difference import first_difference
from lgmpc.runs.folder import CONFIG_FILE
from lgmpc.settings.dotted import Difference, differing
from lgmpc.sweeps.folder import DOCUMENT, ROWS, read_document, read_rows
from lgmpc.sweeps.rows import Estimate, Row, mean_difference, paired, place

_HIGHER_IS_BETTER = ("survived_s", "real_time_factor", "passed", "boundary", "walking.ends_standing")


@dataclass(frozen=True)
class Quantity:
    """A quantity that was measured on both sides.

    Attributes:
        name: a metric, a limit of the gate, ``passed`` or ``boundary``.
        first: value of the first side; for sweeps the mean over the pairs.
        second: value of the second side.
        difference: for sweeps the mean difference in pairs.
        limit: for runs the gate's limit; ``None`` if it has none.
        worsening: worsening from first to second as a share of the limit or, without one, of the first value. Negative
            for an improvement; ``None`` where it is not judged.
        worse: whether the worsening exceeds the margin and, for sweeps, is significant.
    """

    name: str
    first: float | None
    second: float | None
    difference: Estimate | None = None
    limit: float | None = None
    worsening: float | None = None
    worse: bool = False


@dataclass(frozen=True)
class Comparison:
    """Two runs or sweeps.

    Attributes:
        first: folder of the first.
        second: folder of the second.
        margin: share by which the second may be worse.
        differences: keys of the configs, or of the documents of the sweeps, that differ.
        quantities: quantities measured on both sides.
        log: the first bitwise difference of the logs of two closed loops in words; empty if they are equal,
            ``None`` of sweeps and of solved problems.
        reasons: sentences on why the second is worse; empty if it is not.
    """

    first: str
    second: str
    margin: float
    differences: tuple[Difference, ...]
    quantities: tuple[Quantity, ...]
    reasons: tuple[str, ...]
    log: str | None = None

    @property
    def worse(self) -> bool:
        """Whether the second is worse beyond the margin."""
        return bool(self.reasons)

    def content(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        content = asdict(self) | {"differences": [each._asdict() for each in self.differences]}
        return {"worse": self.worse, **json_values(content)}


def is_sweep(path: Path) -> bool:
    """Return whether a folder is that of a sweep."""
    return (path / DOCUMENT).is_file()


def compare_folders(first: Path, second: Path, *, margin: float = 0.05, metrics: Sequence[str] = ()) -> Comparison:
    """Compare two runs or two sweeps.

    Of runs, the second is worse if only the first passed, or if a metric that the first's gate limits worsened by more
    than ``margin`` times that limit; times of computing are shown but not judged. Sweeps are compared in pairs: points
    of the same base, variant, levels and draw. The second is worse if the share that passes, or the mean boundary,
    worsened by more than ``margin`` times the first's, and a 95 % bootstrap interval of the differences excludes zero.

    Args:
        first: folder of the reference.
        second: folder of the candidate.
        margin: share, at least 0.
        metrics: further metrics to judge, relative to the first's value.

    Raises:
        InputError: a margin below 0, an unknown metric, or two folders of different kinds: sweep, run of a closed
            loop, solved problem.
        RunFolderError: a folder is not that of a run or of a sweep, or two sweeps have no point in common.
    """
    if not 0.0 <= margin < math.inf:
        raise InputError("margin", margin, "a number, 0 or above")
    a, b = (None if is_sweep(each) else load_run(each) for each in (first, second))
    if type(a) is not type(b):
        raise InputError("B", f"{_kind(b)} ({second})", f"{_kind(a)}, as A is")
    if a is None or b is None:
        differences, quantities = _compare_sweeps(first, second, margin, metrics)
        reasons: list[str] = []
    else:
        differences = list(differing(_config(a).model_dump(mode="json"), _config(b).model_dump(mode="json")))
        quantities = _compare_runs(a, b, margin, metrics)
        failed = a.result.verdict.passed and not b.result.verdict.passed
        reasons = [f"only the first passed: {'; '.join(b.result.verdict.reasons)}"] if failed else []
    for name in metrics:
        if name not in [each.name for each in quantities]:
            raise InputError("metric", name, "a metric of both", [each.name for each in quantities], word=name)
    reasons += [_sentence(each) for each in quantities if each.worse]
    where = str(first_difference(a.log, b.log) or "") if isinstance(a, Run) and isinstance(b, Run) else None
    return Comparison(str(first), str(second), margin, tuple(differences), tuple(quantities), tuple(reasons), where)


def judged(
    name: str, first: float | None, second: float | None, margin: float = 0.0, limit: float | None = None
) -> Quantity:
    """Return the comparison of two values; where what it is relative to is zero, any worsening exceeds the margin.

    Args:
        name: as in :class:`Quantity`, and so are the next two.
        first: value of the first side.
        second: value of the second side.
        margin: share of the limit or, without one, of the first value by which the second may be worse.
        limit: the gate's limit, if any.
    """
    if name.endswith(("_ms", "real_time_factor")) or "_ms." in name or first is None or second is None:
        return Quantity(name, first, second)
    worsening = first - second if higher_is_better(name) else second - first
    scale = abs(first if limit is None else limit)
    share = worsening / scale if scale > 0.0 else math.inf if worsening > 0.0 else 0.0
    return Quantity(name, first, second, limit=limit, worsening=share, worse=share > margin)


def higher_is_better(name: str) -> bool:
    """Return whether larger values of a metric are better."""
    return name in _HIGHER_IS_BETTER or name.rpartition(".")[2].startswith("min_")


def _kind(side: Run | SolvedRun | None) -> str:
    if side is None:
        return "a sweep"
    return "a solved problem" if isinstance(side, SolvedRun) else "the run of a closed loop"


def _compare_runs(a: Run | SolvedRun, b: Run | SolvedRun, margin: float, wanted: Sequence[str]) -> list[Quantity]:
    config = _config(a)
    limits, first, second = config.gate.limits, a.result.figures, b.result.figures
    pairs = zip(a.result.limited(limits), b.result.limited(limits), strict=True)
    found = [judged(name, x, y, margin, limit) for (name, x, limit), (_, y, _) in pairs]
    for name in dict.fromkeys([*first, *second]):
        x, y = first.get(name), second.get(name)
        if name in wanted:
            found.append(judged(name, x, y, margin))
        elif (x, y) != (None, None) and not {f"max_{name}", f"min_{name}", name} & limits.keys():
            found.append(Quantity(name, x, y))
    return found


def _config(run: Run | SolvedRun) -> Config | SolveConfig:
    return parse_any_config(run.config, name=str(run.path / CONFIG_FILE))


def _compare_sweeps(
    first: Path, second: Path, margin: float, wanted: Sequence[str]
) -> tuple[list[Difference], list[Quantity]]:
    a, b = _rows(first), _rows(second)
    pairs = [(row, b[where]) for where, row in a.items() if where in b]
    if not pairs:
        raise RunFolderError(f"{first} and {second} have no finished point in common: other bases, factors or draws")
    differences = [Difference("points", len(a), len(b))] if a.keys() != b.keys() else []
    differences += differing(read_document(first / DOCUMENT), read_document(second / DOCUMENT))
    quantities = []
    for name, values in paired(pairs).items():
        change = mean_difference([y - x for x, y in values])
        x, y = (math.fsum(each) / len(values) for each in zip(*values, strict=True))
        shift = judged(name, x, y, margin) if name in ("passed", "boundary", *wanted) else Quantity(name, x, y)
        beyond_chance = change.high < 0.0 if higher_is_better(name) else change.low > 0.0
        quantities.append(replace(shift, difference=change, worse=shift.worse and beyond_chance))
    return differences, quantities


def _rows(folder: Path) -> dict[str, Row]:
    """Return the rows that have a verdict, by base, variant, levels and draw."""
    return {place(row): row for row in read_rows(folder / ROWS).values() if row.ending.computed}


def _sentence(quantity: Quantity) -> str:
    first, second, share, limit = quantity.first, quantity.second, quantity.worsening, quantity.limit
    much = ""
    if limit is not None and first and second and first * second > 0.0:
        much = f", {second / first:.3g} times as much"
    if share is not None and not math.isinf(share):
        much += f", worse by {100.0 * share:.3g} %" + (" of A's" if limit is None else f" of the limit of {limit:.4g}")
    interval = "" if quantity.difference is None else f" (mean difference in pairs {quantity.difference})"
    return f"{quantity.name}: {quantity.first:.4g} became {quantity.second:.4g}{much}{interval}"
