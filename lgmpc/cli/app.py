"""The commands: their names, arguments and options. Examples are in ``examples.txt``."""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lgmpc import __version__
from lgmpc.cli import studies
from lgmpc.cli.options import (
    OVERVIEW,
    AsJson,
    ConfigFile,
    MoreOverrides,
    OutFolder,
    Overrides,
    Quiet,
    RunName,
    RunsFolder,
    argument,
    complete_config,
    complete_demo,
    complete_run,
    examples,
    option,
)
from lgmpc.cli.screen import err, guarded, out as stdout, show_page
from lgmpc.errors import InputError

if TYPE_CHECKING:
    from lgmpc.config import Config

app = typer.Typer(
    name="lgmpc",
    help=OVERVIEW,
    invoke_without_command=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
DriverName = Annotated[
    Literal["udp", "unitree", "odri"], option("Link: UDP, the topics of Unitree's robots, or ODRI's library.")
]
Interface = Annotated[
    str | None, option("Network interface of a Unitree robot (lo: one simulated here); YAML file of an ODRI robot.")
]
Secret = Annotated[
    Path | None,
    option("File of mode 600 with the secret of the link; unless given, the user's own, which programs here share."),
]


def _command(function: Callable[..., int | None]) -> Callable[..., None]:
    """Add a command, with its examples; exceptions in it become messages and exit codes."""
    return app.command(epilog=examples(function.__name__))(guarded(function))


def _version(wanted: bool) -> None:
    if wanted:
        print(f"lgmpc {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Print the help if there is no command."""
    if context.invoked_subcommand is None:
        print(context.get_help())


@_command
def run(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006 (typer copies it)
    overrides: Overrides = [],  # noqa: B006
    out: OutFolder = Path("runs"),
    plant: Annotated[
        Literal["mujoco", "pinocchio"] | None, option("Physics engine; the config's if not given.")
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    view: Annotated[bool, typer.Option("--view", help="Show it on a page in the browser while it runs.")] = False,
) -> int:
    """Simulate a config, save the run and judge it.

    Shows progress while it runs. Ctrl-C saves what was recorded until then and marks it as interrupted.
    """
    from lgmpc.cli.running import run_shown

    changes = [*overrides, *more, *([f"plant.kind={plant}"] if plant else [])]
    return run_shown(config, changes, out, as_json=as_json, quiet=quiet, view=view)


@_command
def live(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006 (typer copies it)
    overrides: Overrides = [],  # noqa: B006
    out: OutFolder = Path("runs"),
    duration: Annotated[
        float, typer.Option(min=1.0, help="Longest simulated time of a run, s; all of it is kept in memory.")
    ] = 300.0,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 takes any free one.")] = 8080,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser on this machine.")] = True,
    host: Annotated[str, typer.Option(help="Address to serve the page at; other ones need a token.")] = "127.0.0.1",
    robot: Annotated[
        str,
        option(
            "Drive a robot instead of a simulation, disarmed at first: HOST:PORT, as of `lgmpc robot`; of Unitree's"
            " the network interface, of ODRI's the YAML file."
        ),
    ] = "",
    driver: DriverName = "udp",
    secret: Secret = None,
) -> int | None:
    """Simulate a config in real time, shown on a page that also drives it: commands, pushes, settings, world.

    Commands, pushes and changes of the config are replaced by those of the page. Ctrl-C saves the run.
    """
    from lgmpc.live.viewing import Viewing

    end, udp = None, driver == "udp"
    if robot:
        from lgmpc.cli.running import RobotEnd
        from lgmpc.hardware.udp import parse_address

        end = RobotEnd(driver, parse_address(robot) if udp else None, secret, None if udp else robot)
    elif secret or not udp:
        raise InputError("--robot", "none", "that of --driver or --secret")

    @cache
    def load() -> "Config":
        from lgmpc.config import load_config

        return load_config(config, [*overrides, *more])

    console = err()
    with Viewing(port, browser, host).open(partial(console.print, markup=False), load) as link:
        from lgmpc.cli.running import deploy_shown, live_shown

        if end is None:
            live_shown(load(), link, out, duration)
            return None
        return deploy_shown(load().replace({"duration_s": duration}), end, out, disarmed=True, page=link)


@_command
def solve(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006
    overrides: Overrides = [],  # noqa: B006
    out: OutFolder = Path("runs"),
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Optimise the trajectory of a config, save it and judge it.

    Shows the iterations. Ctrl-C saves the present trajectory and marks it as interrupted.
    """
    from lgmpc.config import load_solve_config

    loaded = load_solve_config(config, [*overrides, *more])
    from lgmpc.cli.running import solve_shown

    return solve_shown(loaded, out, as_json=as_json, quiet=quiet)


@_command
def deploy(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006 (typer copies it)
    overrides: Overrides = [],  # noqa: B006
    address: Annotated[
        str | None, option("Address of the robot; 127.0.0.1:47800 if not given.", "--robot", metavar="HOST:PORT")
    ] = None,
    driver: DriverName = "udp",
    secret: Secret = None,
    interface: Interface = None,
    disarmed: Annotated[bool, typer.Option("--disarmed", help="Send nothing until the key a is pressed.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Compute commands, but send none.")] = False,
    out: OutFolder = Path("runs"),
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Run a config's controllers on a robot in real time, save the run and judge it.

    Requires an estimator in the config. The run is judged by the estimate. At the end, after Ctrl-C, and while no
    measurements arrive, the joints are damped. Keys: space stops at once, l lies down and ends, d disarms, a arms.
    """
    from lgmpc.config import load_config

    loaded = load_config(config, [*overrides, *more])
    from lgmpc.cli.running import RobotEnd, deploy_shown
    from lgmpc.hardware.udp import parse_address

    link = RobotEnd(driver, parse_address(address) if address else None, secret, interface)
    return deploy_shown(loaded, link, out, disarmed=disarmed, dry_run=dry_run, as_json=as_json, quiet=quiet)


@_command
def robot(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006
    overrides: Overrides = [],  # noqa: B006
    host: Annotated[str, typer.Option(help="Address of this machine to listen at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen at; 0 takes any free one.")] = 47800,
    driver: DriverName = "udp",
    secret: Secret = None,
    interface: Interface = None,
    lock_step: Annotated[
        bool,
        typer.Option("--lock-step", help="Wait for the answer to each measurement instead of moving in real time."),
    ] = False,
) -> int:
    """Simulate a config's robot in real time, moved by a controller at the other end of a link.

    Waits for `lgmpc deploy`, or for another program that uses its protocol; ends with it, or by Ctrl-C or SIGTERM.
    Pushes, sensor noise, drives and floor are those of the config.
    """
    from lgmpc.config import load_config

    loaded = load_config(config, [*overrides, *more])
    from lgmpc.cli.running import RobotEnd, serve_shown

    address = (host, port)
    end = RobotEnd(driver, None if address == ("127.0.0.1", 47800) else address, secret, interface)
    return serve_shown(loaded, end, lock_step=lock_step)


_command(studies.sweep)


@_command
def play(
    run: RunName,
    html: Annotated[
        Path | None, option("File for the page, not opened; replay.html in the run's own folder if not given.")
    ] = None,
    video: Annotated[Path | None, option("Write a film to this .mp4 or .gif file instead (extra `video`).")] = None,
    runs: RunsFolder = Path("runs"),
) -> None:
    """Replay a run or a solved trajectory in the browser: robot, forces, friction cones, pushes, horizon.

    The page is one self-contained file, which any browser opens, on any machine.
    """
    from lgmpc.config.showing import export as write, show
    from lgmpc.runs import find_run

    folder = find_run(run, runs)
    if video is not None:
        if video.suffix not in (".mp4", ".gif"):
            raise InputError("--video", video.name, "a file that ends in .mp4 or .gif")
        stdout().print(f"wrote {write(folder, video)}", markup=False)
    if (html is not None or video is None) and (file := show(folder, html)) is not None:
        show_page(file)


@_command
def export(
    run: RunName,
    csv: Annotated[Path | None, option("A table as CSV; the header has the units.", "--csv", metavar="FILE")] = None,
    parquet: Annotated[
        Path | None, option("A table as Parquet; fields have their units.", "--parquet", metavar="FILE")
    ] = None,
    mcap: Annotated[Path | None, option("All of a closed loop for Foxglove.", "--mcap", metavar="FILE")] = None,
    rrd: Annotated[Path | None, option("All of a closed loop for rerun.", "--rrd", metavar="FILE")] = None,
    dataset: Annotated[
        Path | None,
        option("Run, or kept runs of a sweep's folder, for imitation: LeRobot, or an .hdf5 file.", "--dataset"),
    ] = None,
    c: Annotated[
        Path | None,
        option("Whole-body tick and MPC update as C libraries, with the run's to replay.", "--c", metavar="FOLDER"),
    ] = None,
    table: Annotated[
        str | None,
        option("Table of --csv and --parquet: ticks, mpc; of a solve nodes, intervals, iterations.", metavar="NAME"),
    ] = None,
    runs: RunsFolder = Path("runs"),
) -> None:
    """Write a run for other tools: pandas and spreadsheets, Foxglove, rerun (extra `data`)."""
    from lgmpc.config.showing import export as write
    from lgmpc.runs import find_run

    files = {"--csv": csv, "--parquet": parquet, "--mcap": mcap, "--rrd": rrd}
    wanted = {name: file for name, file in files.items() if file is not None}
    if not wanted and dataset is None and c is None:
        raise InputError("lgmpc export", "no file", f"at least one of {', '.join(files)}, --dataset, --c")
    for name, file in wanted.items():
        if file.suffix != f".{name[2:]}":
            raise InputError(name, file.name, f"a file that ends in .{name[2:]}")
    folder = find_run(run, runs)
    if dataset is not None:
        from lgmpc.sweeps.dataset import write_dataset

        episodes, frames = write_dataset(folder, dataset)
        stdout().print(f"wrote {dataset}: {episodes} episodes, {frames} frames", markup=False)
    for file in wanted.values():
        stdout().print(f"wrote {write(folder, file, table)}", markup=False)
    if c is not None:
        from lgmpc.config.exporting import export_controller

        ticks, updates = export_controller(folder, c)
        of_mpc = f", {updates} updates of the MPC" if updates else ""
        stdout().print(f"wrote {c}: C sources and {ticks} ticks{of_mpc}. Build and replay them:", markup=False)
        build = f"cmake -S {c} -B {c}/build && cmake --build {c}/build"
        stdout().print(f"  {build} && ctest --test-dir {c}/build --verbose", markup=False)


@_command
def plot(
    run: RunName,
    out: Annotated[Path | None, option("Folder for the figures; figures/ in the run's own if not given.")] = None,
    runs: RunsFolder = Path("runs"),
) -> None:
    """Draw the figures of a run (motion, forces, torques, timings) or of a solved trajectory."""
    from lgmpc.config.showing import plot as draw
    from lgmpc.runs import find_run

    folder = find_run(run, runs)
    for figure in draw(folder).save(out or folder / "figures"):
        stdout().print(f"wrote {figure}", markup=False)


@_command
def explain(run: RunName, runs: RunsFolder = Path("runs"), as_json: AsJson = False) -> None:
    """Explain why a run failed: the events before the failure, in order.

    Events are limits reached, contacts and solutions lost, capture point outside the support, late ticks, wrong
    estimates. For a run that passed: its smallest margin to each limit. For a solve: course, end and margins.
    """
    from lgmpc.cli.inspecting import explain_shown
    from lgmpc.runs import find_run

    explain_shown(find_run(run, runs), as_json=as_json)


@_command
def report(
    run: Annotated[
        str, argument("A run folder, `latest`, or a sweep's folder.", metavar="RUN|SWEEP", complete=complete_run)
    ],
    html: Annotated[Path | None, option("File to write; report.html in the folder itself if not given.")] = None,
    runs: RunsFolder = Path("runs"),
) -> None:
    """Write one self-contained page: verdict, events, figures, replay, config, versions; of a sweep its tables.

    It requires no network and no other file, suits phones, light and dark screens, and prints.
    """
    from lgmpc.config.showing import report as write
    from lgmpc.runs import find_run
    from lgmpc.sweeps.comparison import is_sweep
    from lgmpc.sweeps.report import write_sweep_report

    folder = Path(run)
    show_page(write_sweep_report(folder, html) if is_sweep(folder) else write(find_run(run, runs), html))


_command(studies.compare)


@_command
def demo(
    name: Annotated[
        str,
        typer.Argument(metavar="[NAME]", help="Its name; all are listed if not given.", autocompletion=complete_demo),
    ] = "",
    out: Annotated[Path, typer.Option(help="Folder for table, figure and scene.")] = Path("demos"),
    view: Annotated[bool, typer.Option(help="Open the scene in a browser, if there is a desktop.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print the table as JSON.")] = False,
) -> int | None:
    """Compare predictions of geometric mechanics with simulations.

    Prints and writes a table, and writes a figure and, for demonstrations with moving bodies, a scene. Exit code 0 if
    prediction and measurement agree, 1 if they do not.
    """
    from lgmpc.cli.demonstrating import list_demos, show_demo

    if not name:
        list_demos()
        return None
    return show_demo(name, out, view=view, as_json=as_json)


@_command
def check(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Check a config without running or solving it: keys, values, robot, frames, bodies of pushes, figures."""
    from lgmpc.config import load_any_config

    loaded = load_any_config(config, [*overrides, *more])
    from lgmpc.cli.inspecting import show_checked

    show_checked(loaded)


@_command
def configs(
    copy: Annotated[
        str, option("Write this one to DEST instead of listing them.", metavar="NAME", complete=complete_config)
    ] = "",
    destination: Annotated[
        Path | None, argument("File or folder to write to; this folder if not given.", metavar="[DEST]")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """List the configs that come with lgmpc, or write one of them to a file to edit."""
    from lgmpc.cli.inspecting import copy_config, list_configs

    if copy:
        copy_config(copy, destination, force=force)
    elif destination is not None or force:
        raise InputError("--copy", "nothing", "the name of the config to write")
    else:
        list_configs()


@_command
def doctor() -> int:
    """Show installed packages, compiler and compile cache, and test them.

    Exit code 0 if everything works, 1 if something is broken.
    """
    from lgmpc.cli.inspecting import show_diagnosis

    return show_diagnosis()


@_command
def schema() -> None:
    """Print the JSON schema of configs, from which editors complete and explain keys."""
    from lgmpc.config.schema import json_schema_text

    print(json_schema_text(), end="")
