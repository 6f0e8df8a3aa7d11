"""Output of ``lgmpc deploy`` and ``lgmpc robot``."""

from __future__ import annotations

from pathlib import Path

from lgmpc.cli.display import Row, figure_table, warnings_on
from lgmpc.cli.running import run_display, show_run
from lgmpc.cli.screen import err, out, print_result
from lgmpc.config import Config
from lgmpc.config.deploying import deploy_config, serve_config
from lgmpc.config.interrupts import stop_signals
from lgmpc.errors import Interrupted
from lgmpc.hardware import Deployment, UdpDriver, UdpRobot
from lgmpc.runs.metrics import timing

__all__ = ["deploy_shown", "serve_shown"]


def deploy_shown(config: Config, address: tuple[str, int], folder: Path, *, as_json: bool, quiet: bool) -> int:
    """Run ``config`` on the robot at ``address``, print the verdict, and return the exit code."""
    console = err()
    with run_display(console, quiet=quiet) as display, warnings_on(console):
        finished, deployment = deploy_config(
            config, lambda nu: UdpDriver(address, nu), folder, notify=display.announce, progress=display.advance
        )
    if as_json:
        print_result(finished.folder.path, finished.result)
        return finished.exit_code
    if not quiet:
        out().print(figure_table(_link(deployment)))
    show_run(finished, quiet=quiet)
    return finished.exit_code


def serve_shown(config: Config, host: str, port: int, *, lock_step: bool) -> int:
    """Simulate the robot of ``config``, print figures of its motion and of the link, and return the exit code."""
    console = err()
    with warnings_on(console), stop_signals():
        served = serve_config(
            config,
            lambda nu: UdpRobot(nu, host, port),
            lock_step=lock_step,
            notify=lambda message: console.print(message, markup=False),
        )
    rows = [
        Row("simulated", "s", float(served.time[-1])),
        Row("largest tilt", "deg", served.max_tilt_deg),
        Row("displacement at the end", "mm", 1e3 * served.final_displacement_m),
        Row("ticks behind the clock", "", float(served.behind)),
        Row("ticks without a command", "", float(served.unanswered)),
    ]
    out().print(figure_table(rows))
    out().print(f"the robot ended: {served.ending}", markup=False)
    return 0 if served.signal is None else Interrupted(served.signal).exit_code


def _link(deployment: Deployment) -> list[Row]:
    spent = timing(1e3 * deployment.spent)
    return [
        Row("measurements answered", "", float(deployment.ticks)),
        Row("measurements overtaken", "", float(deployment.overtaken)),
        Row("measurements missing", "", float(deployment.missing)),
        Row("commands late", "", float(deployment.late)),
        *([Row("command after p50", "ms", spent.p50), Row("command after p99", "ms", spent.p99)] if spent else []),
    ]
