"""Arguments and options of the commands about many runs: sweeps, comparisons."""

from pathlib import Path
from typing import Annotated

import typer

from lgmpc.cli import options


def sweep(
    file: Annotated[
        Path,
        options.argument(
            "A YAML file, or the name of a shipped sweep (`lgmpc configs` lists them).",
            metavar="SWEEP",
            complete=options.complete_sweep,
        ),
    ],
    more: options.MoreOverrides = [],  # noqa: B006
    overrides: options.Overrides = [],  # noqa: B006
    out: Annotated[Path | None, options.option("Folder of the results; sweeps/NAME if not given.", "--out")] = None,
    workers: Annotated[int | None, options.option("Worker processes; one for each processor if not given.")] = None,
    part: Annotated[
        str, options.option("Compute every N-th point only, from the K-th on, as one of N machines.", metavar="K/N")
    ] = "1/1",
    resume: Annotated[bool, typer.Option("--resume", help="Continue in an existing folder.")] = False,
    dataset: Annotated[
        Path | None,
        options.option(
            "Write the kept runs (`logs.keep`) for imitation too: LeRobot's folder, or an .hdf5 file.", "--dataset"
        ),
    ] = None,
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> int:
    """Run a config at many points: grids, random draws, paired variants, searches of a boundary.

    Every finished point is saved at once: --resume continues a stopped sweep.
    Exit code 0 if every point has a verdict and the sweep's `expect` is satisfied.
    """
    from lgmpc.sweeps import load_sweep

    loaded = load_sweep(file, [*overrides, *more])
    from lgmpc.cli.sweeping import part_of, sweep_shown

    if dataset is not None:
        from lgmpc.sweeps.dataset import check_dataset

        check_dataset(dataset)
    return sweep_shown(part_of(loaded, part), out, workers, dataset, resume=resume, as_json=as_json, quiet=quiet)


def compare(
    first: Annotated[
        str,
        typer.Argument(
            metavar="A", help="A run folder, `latest`, or a sweep's folder.", autocompletion=options.complete_run
        ),
    ],
    second: Annotated[
        str, typer.Argument(metavar="B", help="A run or sweep like A.", autocompletion=options.complete_run)
    ],
    margin: Annotated[float, typer.Option(help="Share by which B may be worse without failing.")] = 0.05,
    metric: Annotated[list[str], typer.Option(help="Judge this metric too; may be repeated.", show_default=False)] = [],  # noqa: B006
    runs: options.RunsFolder = Path("runs"),
    as_json: options.AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show only the verdict.")] = False,
) -> int:
    """Compare two runs or two sweeps: configs, metrics, differences in pairs with 95 % intervals.

    Exit code 1 if B is worse than A: it fails where A passes, or a metric that the gate limits (for sweeps: the share
    that passes, the boundary) is worse by more than the margin; for sweeps also significantly so.
    """
    from lgmpc.cli.sweeping import compare_shown

    return compare_shown(first, second, runs, margin=margin, metrics=tuple(metric), as_json=as_json, quiet=quiet)
