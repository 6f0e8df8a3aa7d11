"""``lgmpc run``, ``deploy``, ``robot`` and ``solve``: progress, and the result."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.text import Text

from lgmpc.cli.display import Display, progress_display, warnings_on
from lgmpc.cli.screen import err, out, print_result, show_next, show_table, show_verdict
from lgmpc.config import Config, SolveConfig, load_config
from lgmpc.config.execution import FinishedRun, FinishedSolve, run_config, solve_config
from lgmpc.config.session import Progress, RunProgress, stop_signals
from lgmpc.errors import InputError, Interrupted
from lgmpc.hardware import Deployment
from lgmpc.live.viewing import Link
from lgmpc.robot import Robot
from lgmpc.runs import Outcome
from lgmpc.runs.certificate import Certificate
from lgmpc.runs.figures import figure_of
from lgmpc.runs.metrics import timing
from lgmpc.runs.tables import limits_table


def run_shown(
    path: Path, changes: Sequence[str], folder: Path, *, as_json: bool, quiet: bool, view: bool = False
) -> int:
    """Run a config with a progress display; return the exit code.

    Args:
        path: of the config.
        changes: ``key=value``.
        folder: of run folders.
        as_json: print ``run.json``.
        quiet: print the verdict only.
        view: show it on a page while it runs.
    """
    config, console = load_config(path, changes), err()
    with _run_display(console, quiet=quiet) as display, warnings_on(console):
        begin = _viewed if view else run_config
        finished = begin(config, folder, notify=display.announce, progress=display.advance)
    if as_json:
        print_result(finished.folder.path, finished.result)
    else:
        _show_run(finished, quiet=quiet)
    return finished.exit_code


def _viewed(
    config: Config, folder: Path, *, notify: Callable[[str], None], progress: Callable[[RunProgress], None]
) -> FinishedRun:
    from lgmpc.live.session import viewed_config
    from lgmpc.live.viewing import Viewing

    with Viewing(port=0).open(notify) as link:
        return viewed_config(config, link, folder, notify=notify, progress=progress)


def live_shown(config: Config, link: "Link", folder: Path, duration_s: float) -> None:
    """Simulate ``config`` in real time, driven from a page, and print where the run was saved."""
    from lgmpc.live.session import live_config

    console = err()
    with warnings_on(console):
        saved = live_config(config, link, folder, duration_s=duration_s, notify=partial(console.print, markup=False))
    if saved is None:
        console.print("nothing was recorded")
    else:
        show_next(out(), saved)


def _show_run(run: FinishedRun, *, quiet: bool) -> None:
    """Print the figures, the verdict, and the commands for the saved run."""
    console, result, figures = out(), run.result, run.result.figures
    if figures and not quiet:
        others = [(name, value) for name in _ALWAYS_SHOWN if (value := figures.get(name)) is not None]
        show_table(limits_table(result.limited(run.config.gate.limits), others))
    show_verdict(console, result.verdict, result.name)
    if not quiet:
        if result.certificate is not None:
            console.print(_certified(result.certificate))
        failed = result.verdict.outcome is Outcome.FAIL
        show_next(console, run.folder.path, *((("explain", "the events that led to the failure"),) if failed else ()))


def _certified(certificate: Certificate) -> Text:
    """Return the checks of a certificate as text: all names, or those that failed."""
    names = ", ".join(check.name for check in certificate.checks)
    if certificate.certified:
        return Text(f"certified: {names}", "dim")
    return Text(f"not certified: {'; '.join(map(str, certificate.broken))}", "yellow")


_ALWAYS_SHOWN = (
    "survived_s",
    "mpc_ms.p50",
    "wbc_ms.p50",
    "estimator_ms.p50",
    "forecast_ms.p50",
    "estimator.max_position_m",
    "estimator.max_tilt_deg",
    "estimator.max_yaw_deg",
    "real_time_factor",
)
"""Metrics that are shown whether the gate limits them or not."""


@contextmanager
def _run_display(console: Console, *, quiet: bool) -> Iterator[Display[RunProgress]]:
    """Show the progress of a run on ``console``: a bar on a terminal, a line per stage elsewhere."""
    begun: list[RunProgress] = []

    def lines(now: RunProgress) -> Iterator[str]:
        if not begun:
            begun.append(now)
            yield f"simulating {now.duration_s:g} s"

    def bar(now: RunProgress) -> Mapping[str, Any]:
        simulated = f"{now.time_s:.1f} / {now.duration_s:g} s"
        state = f"{simulated}  tilt {now.tilt_deg:.2f} deg  {now.real_time_factor:.1f} x real time"
        return {"description": "simulating", "completed": now.time_s, "total": now.duration_s, "state": state}

    with progress_display(console, lines, bar, quiet=quiet) as display:
        yield display


class RobotEnd(NamedTuple):
    """The address of a robot, by options of the command line.

    Attributes:
        driver: udp, unitree or odri.
        address: host and port, of UDP; None for the default.
        secret: file, of UDP; None for the user's own.
        interface: network interface of Unitree's robots, file of ODRI's; None for the default.
    """

    driver: str
    address: tuple[str, int] | None
    secret: Path | None
    interface: str | None

    def end(self, *, robots: bool, period: float = 0.0) -> "Callable[[Robot], Any]":
        """Return the constructor of the controller's or the robot's end; ``period`` is that of the ticks, s."""
        udp, interface = self.driver == "udp", self.interface or ("lo" if robots else "eth0")
        address = "--host, --port" if robots else "--robot"
        foreign = {"--interface": self.interface} if udp else {address: self.address, "--secret": self.secret}
        for option, given in foreign.items():
            if given is not None:
                raise InputError(option, given, f"none: --driver {self.driver} does not use it")
        if self.driver == "odri":
            if robots:
                raise InputError("--driver", "odri", "a link that a simulated robot speaks", ("udp", "unitree"))
            from lgmpc.hardware.odri import OdriDriver

            return lambda robot: OdriDriver(interface, robot.q_reference[robot.joint_q], period)
        if self.driver == "unitree":
            from lgmpc.hardware.unitree import UnitreeDriver, UnitreeRobot

            return lambda robot: (UnitreeRobot if robots else UnitreeDriver)(robot.joint_names, interface)
        from lgmpc.hardware import UdpDriver, UdpRobot
        from lgmpc.hardware.packets import read_secret

        secret, at = read_secret(self.secret), self.address or ("127.0.0.1", 47800)

        def udp_end(robot: Robot) -> UdpRobot | UdpDriver:
            name = " ".join([robot.name, *robot.joint_names])
            return UdpRobot(robot.nu, *at, secret, name) if robots else UdpDriver(at, robot.nu, secret, name)

        return udp_end


def deploy_shown(
    config: Config,
    link: RobotEnd,
    folder: Path,
    *,
    disarmed: bool,
    dry_run: bool = False,
    as_json: bool = False,
    quiet: bool = False,
    page: "Link | None" = None,
) -> int:
    """Run ``config`` on a robot, driven from a page if there is one; print the verdict, and return the exit code."""
    from lgmpc.config.deploying import deploy_config
    from lgmpc.hardware.safety import Keys

    begin = deploy_config
    if page is not None:
        from lgmpc.live.deployed import deployed_config

        begin = partial(deployed_config, link=page)
    console, driver = err(), link.end(robots=False, period=1.0 / config.wbc.rate_hz)
    with Keys.of_terminal(not disarmed) as keys, _run_display(console, quiet=quiet) as display, warnings_on(console):
        finished, deployment = begin(
            config, driver, folder, notify=display.announce, progress=display.advance, operator=keys, dry_run=dry_run
        )
    if as_json:
        print_result(finished.folder.path, finished.result)
        return finished.exit_code
    if not quiet:
        show_table(limits_table((), _link(deployment).items()))
    _show_run(finished, quiet=quiet)
    return finished.exit_code


def serve_shown(config: Config, link: RobotEnd, *, lock_step: bool) -> int:
    """Simulate the robot of ``config``, print figures of its motion and of the link, and return the exit code."""
    from lgmpc.config.deploying import serve_config

    console, end = err(), link.end(robots=True)
    with warnings_on(console), stop_signals():
        served = serve_config(config, end, lock_step=lock_step, notify=partial(console.print, markup=False))
    figures = {
        "simulated_s": float(served.time[-1]),
        "largest_tilt_deg": served.max_tilt_deg,
        "displacement_at_the_end_m": served.final_displacement_m,
        "ticks_behind_the_clock": served.behind,
        "ticks_without_a_command": served.unanswered,
    }
    show_table(limits_table((), figures.items()))
    out().print(f"the robot ended: {served.ending}", markup=False)
    return 0 if served.signal is None else Interrupted(served.signal).exit_code


def _link(deployment: "Deployment") -> dict[str, float]:
    spent = timing(1e3 * deployment.spent)
    return {
        "measurements_answered": deployment.ticks,
        "measurements_overtaken": deployment.overtaken,
        "measurements_missing": deployment.missing,
        "commands_late": deployment.late,
        **({"command_p50_ms": spent.p50, "command_p99_ms": spent.p99} if spent else {}),
    }


def solve_shown(config: SolveConfig, folder: Path, *, as_json: bool, quiet: bool) -> int:
    """Solve the problem of ``config`` with a display of iterations, print the verdict, and return the exit code."""
    console = err()
    with _solve_display(console, config, quiet=quiet) as display, warnings_on(console):
        finished = solve_config(config, folder, notify=display.announce, progress=display.advance)
    if as_json:
        print_result(finished.folder.path, finished.result)
    else:
        _show_solve(finished, config, quiet=quiet)
    return finished.exit_code


def _show_solve(finished: FinishedSolve, config: SolveConfig, *, quiet: bool) -> None:
    console, outcome = out(), finished.outcome
    if not quiet:
        limits = config.gate.limits
        limited = set(map(figure_of, limits))
        others = [each for each in outcome.figures.items() if each[0] not in limited and not math.isnan(each[1])]
        show_table(limits_table(finished.result.limited(limits), others))
    if outcome.explanation and not (quiet and outcome.converged) and outcome.verdict.outcome is not Outcome.INTERRUPTED:
        console.print(Text(outcome.explanation))
    show_verdict(console, outcome.verdict, finished.result.name)
    if not quiet:
        show_next(console, finished.folder.path)


Columns = Mapping[str, Callable[[Progress], str]]
"""Heading of each column, and its text for an iteration."""


def _columns(method: str) -> Columns:
    """Return the columns of a method: the criterion of FDDP is the expected reduction, that of SQP the residual."""
    criterion = "reduction" if "fddp" in method else "residual"
    return {
        "iteration": lambda now: str(now.iteration),
        "cost": lambda now: f"{now.cost:.6g}",
        criterion: lambda now: _scientific(now.criterion),
        "gap": lambda now: _scientific(now.gap),
        "step": lambda now: _number(now.step_length) if now.accepted else "rejected",
        "regularis.": lambda now: _scientific(now.regularization),
        "ms": lambda now: f"{1e3 * now.elapsed:.0f}",
    }


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"


def _scientific(value: float) -> str:
    return "-" if math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"


@contextmanager
def _solve_display(console: Console, config: SolveConfig, *, quiet: bool) -> Iterator[Display[Progress]]:
    """Print a line for each iteration, with headings in between, and on terminals a bar of the stage."""
    columns, rows = _columns(config.solver.method), count()

    def lines(now: Progress) -> Iterator[str]:
        if next(rows) % 20 == 0:
            yield "".join(f"{name:>14}" for name in columns)
        yield "".join(f"{write(now):>14}" for write in columns.values())

    with progress_display(console, lines, lambda now: {}, quiet=quiet, above=True) as display:
        yield display
