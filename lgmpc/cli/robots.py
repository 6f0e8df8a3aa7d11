"""``lgmpc deploy`` and ``lgmpc robot``: a controller and a robot in two processes, in real time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lgmpc.cli.failures import guarded
from lgmpc.cli.options import AsJson, ConfigFile, MoreOverrides, OutFolder, Overrides, Quiet

__all__ = ["deploy", "robot"]

PORT = 47800


@guarded
def deploy(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006 (typer copies it)
    overrides: Overrides = [],  # noqa: B006
    address: Annotated[str, typer.Option("--robot", metavar="HOST:PORT", help="Address of the robot.")] = (
        f"127.0.0.1:{PORT}"
    ),
    out: OutFolder = Path("runs"),
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Run a config's controllers on a robot in real time, over UDP, save the run and judge it.

    Requires an estimator in the config. The run is judged by the estimate. At the end, after Ctrl-C, and while no
    measurements arrive, the joints are damped.
    """
    from lgmpc.config import load_config

    loaded = load_config(config, [*overrides, *more])
    from lgmpc.cli.deploying import deploy_shown
    from lgmpc.hardware.udp import parse_address

    raise typer.Exit(deploy_shown(loaded, parse_address(address), out, as_json=as_json, quiet=quiet))


@guarded
def robot(
    config: ConfigFile,
    more: MoreOverrides = [],  # noqa: B006
    overrides: Overrides = [],  # noqa: B006
    host: Annotated[str, typer.Option(help="Address of this machine to listen at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen at; 0 takes any free one.")] = PORT,
    lock_step: Annotated[
        bool,
        typer.Option("--lock-step", help="Wait for the answer to each measurement instead of moving in real time."),
    ] = False,
) -> None:
    """Simulate a config's robot in real time, moved by a controller at the other end of a UDP link.

    Waits for `lgmpc deploy`, or for another program that uses its protocol; ends with it, or by Ctrl-C or SIGTERM.
    Pushes, sensor noise, drives and floor are those of the config.
    """
    from lgmpc.config import load_config

    loaded = load_config(config, [*overrides, *more])
    from lgmpc.cli.deploying import serve_shown

    raise typer.Exit(serve_shown(loaded, host, port, lock_step=lock_step))
