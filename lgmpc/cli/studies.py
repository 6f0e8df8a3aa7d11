"""Arguments and options of the commands about many runs: sweeps, comparisons, tuning."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lgmpc.cli.options import (
    AsJson,
    MoreOverrides,
    Overrides,
    Quiet,
    RunsFolder,
    argument,
    complete_config,
    complete_run,
    complete_sweep,
    option,
)

__all__ = ["compare", "sweep", "tune"]

Workers = Annotated[int | None, option("Worker processes; one for each processor if not given.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue in an existing folder.")]
Changes = Annotated[list[str], option("Change a value; may be repeated.", "--set", metavar="KEY=VALUE")]
NewFolder = Annotated[Path | None, option("Folder of the results; named after CONFIG if not given.", "--out")]


def sweep(
    file: Annotated[
        Path,
        argument(
            "A YAML file, or the name of a shipped sweep (`lgmpc configs` lists them).",
            metavar="SWEEP",
            complete=complete_sweep,
        ),
    ],
    more: MoreOverrides = [],  # noqa: B006
    overrides: Overrides = [],  # noqa: B006
    out: NewFolder = None,
    workers: Workers = None,
    part: Annotated[
        str, option("Compute every N-th point only, from the K-th on, as one of N machines.", metavar="K/N")
    ] = "1/1",
    resume: Resume = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Run a config at many points: grids, random draws, paired variants, searches of a boundary.

    Every finished point is saved at once: --resume continues a stopped sweep.
    Exit code 0 if every point has a verdict and the sweep's `expect` is satisfied.
    """
    from lgmpc.sweeps import load_sweep

    loaded = load_sweep(file, [*overrides, *more])
    from lgmpc.cli.sweeping import Job, part_of, sweep_shown

    return sweep_shown(part_of(loaded, part), Job(out, workers, resume, as_json, quiet))


def compare(
    first: Annotated[
        str,
        typer.Argument(metavar="A", help="A run folder, `latest`, or a sweep's folder.", autocompletion=complete_run),
    ],
    second: Annotated[str, typer.Argument(metavar="B", help="A run or sweep like A.", autocompletion=complete_run)],
    margin: Annotated[float, typer.Option(help="Share by which B may be worse without failing.")] = 0.05,
    metric: Annotated[list[str], typer.Option(help="Judge this metric too; may be repeated.", show_default=False)] = [],  # noqa: B006
    runs: RunsFolder = Path("runs"),
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show only the verdict.")] = False,
) -> int:
    """Compare two runs or two sweeps: configs, metrics, differences in pairs with 95 % intervals.

    Exit code 1 if B is worse than A: it fails where A passes, or a metric that the gate limits (for sweeps: the share
    that passes, the boundary) is worse by more than the margin; for sweeps also significantly so.
    """
    from lgmpc.cli.sweeping import compare_shown

    return compare_shown(first, second, runs, margin=margin, metrics=tuple(metric), as_json=as_json, quiet=quiet)


def tune(
    source: Annotated[
        Path,
        argument(
            "A config, tuned over seeds, or a sweep, tuned over its points.",
            metavar="CONFIG|SWEEP",
            complete=complete_config,
        ),
    ],
    keys: Annotated[
        list[str],
        typer.Option(
            "--keys",
            metavar="KEY...",
            help="Keys to tune: KEY (a third to three times the present value), KEY=LOW:HIGH, KEY=LOW:HIGH:log, or "
            "KEY=[A, B]. Vectors are scaled. More may follow, or the option again.",
            show_default=False,
        ),
    ] = [],  # noqa: B006
    more: Annotated[list[str], typer.Argument(metavar="KEY", help="More keys.", hidden=True, show_default=False)] = [],  # noqa: B006
    objective: Annotated[
        str, typer.Option(help="A metric of the runs, `passed`, or for sweeps that bisect `boundary`.")
    ] = "max_tilt_deg",
    trials: Annotated[int, typer.Option(help="Number of trials, the first with the present values.")] = 40,
    overrides: Changes = [],  # noqa: B006
    seeds: Annotated[
        int | None, typer.Option(help="Seeds of a config that are tuned over, and as many held out; 4 if not given.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the search.")] = 0,
    out: NewFolder = None,
    workers: Workers = None,
    resume: Resume = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Search values of keys that improve an objective without failing more points (package optuna).

    The result is compared with the present values on held-out points (other seeds, draws and directions) and written
    as a config with its provenance. Exit code 0 if it is better on those, 1 if not.
    """
    from lgmpc.cli.sweeping import Job, tune_shown

    job = Job(out, workers, resume, as_json, quiet)
    return tune_shown(source, [*keys, *more], objective, overrides, job, trials=trials, seeds=seeds, seed=seed)
