"""``lgmpc tune``: progress of the trials, and the gain of the result."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.text import Text

from lgmpc.cli.display import counting_display, duration_words
from lgmpc.cli.screen import err, out, plain_table
from lgmpc.errors import Interrupted
from lgmpc.runs.atomic import json_values
from lgmpc.sweeps.study import Tuned, TuningProgress, tune
from lgmpc.sweeps.summary import level_text
from lgmpc.sweeps.tuning import Score, TuningProblem, tuning_problem

__all__ = ["tune_shown"]


def tune_shown(
    source: Path,
    keys: Sequence[str],
    objective: str,
    overrides: Sequence[str],
    folder: Path | None,
    *,
    trials: int,
    seeds: int | None,
    seed: int,
    workers: int | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Tune, print the gain, and return the exit code: 0 if there is one on the held-out points."""
    problem = tuning_problem(source, keys, objective, overrides=overrides, seeds=seeds)
    folder = folder or Path("tuning") / source.stem
    command = shlex.join(["lgmpc", *sys.argv[1:]])
    search = partial(tune, problem, folder, trials=trials, seed=seed, workers=workers, resume=resume, command=command)
    try:
        with counting_display(err(), trials, "trials", _state, quiet=quiet) as display:
            found = search(notify=display.announce, progress=display.advance)
    except Interrupted as error:
        return _interrupted(error, 0)
    if as_json:
        signal = None if found.signal is None else found.signal.name
        content = asdict(found) | {"files": list(map(str, found.files)), "signal": signal}
        print(json.dumps({"folder": str(folder), **json_values(content)}, indent=2))
    else:
        _show(out(), problem, found)
    if found.signal is not None:
        return _interrupted(Interrupted(found.signal), found.trials)
    return 0 if found.gained else 1


def _interrupted(error: Interrupted, trials: int) -> int:
    words = f"INTERRUPTED  after {trials} trials: the same command with --resume continues"
    err().print(Text(words, "bold yellow"))
    return error.exit_code


def _by_chance(found: Tuned) -> bool:
    """Return whether as many held-out points pass, and the interval of the difference contains zero."""
    first, second, difference = found.initial_held_out, found.best_held_out, found.difference
    if first is None or second is None or difference is None or first.passed != second.passed:
        return False
    return difference.low <= 0.0 <= difference.high


def _show(console: Console, problem: TuningProblem, found: Tuned) -> None:
    table = plain_table("", "initial", f"best (trial {found.trial} of {found.trials})")
    for each in problem.dimensions:
        table.add_row(each.key, level_text(each.value(each.initial)), level_text(found.values[each.key]))
    name = problem.objective.name
    table.add_row(f"{name}, {len(problem.tuned.points)} tuned points", str(found.initial), str(found.best))
    held_out = f"{name}, {len(problem.held_out.points)} held-out points"
    table.add_row(held_out, _score(found.initial_held_out), _score(found.best_held_out))
    console.print(table)
    if found.difference is not None:
        console.print(Text(f"mean difference in pairs on the held-out points: {found.difference}"))
    if found.initial == found.initial_held_out and found.best == found.best_held_out:
        console.print(Text("the held-out points gave the same: nothing is random. Tune over a sweep", "yellow"))
    if found.best_held_out is not None:
        word, style = ("GAINED", "bold green") if found.gained else ("NO GAIN", "bold red")
        console.print(Text.assemble((word, style), "  on held-out points"))
        if found.gained and _by_chance(found):
            console.print(Text("the interval contains 0: tune over more points (samples.count, --seeds)", "yellow"))
    for file in found.files:
        console.print(Text(f"saved in {file}"))


def _score(score: Score | None) -> str:
    return "-" if score is None else str(score)


def _state(now: TuningProgress) -> str:
    return f"  initial {now.initial}  best {now.best}  about {duration_words(now.remaining_s)} left"
