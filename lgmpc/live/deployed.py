"""A robot at the end of a link that a page shows and drives, in place of the config's commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

from lgmpc.config.deploying import DeploymentSession, deploy_config
from lgmpc.config.execution import FinishedRun
from lgmpc.config.schema import Config
from lgmpc.config.session import Notify, ProgressReport, ignore
from lgmpc.hardware.deployment import Deployment, Driver
from lgmpc.hardware.safety import Operator
from lgmpc.live.shown import PICTURE_S, PageCommands, Shown
from lgmpc.live.viewing import Link
from lgmpc.live.wishes import Note, Order
from lgmpc.locomotion.command import CommandEntry
from lgmpc.robot import Robot

__all__ = ["DeployedRun", "deployed_config"]


class DeployedRun(Shown):
    """A run on a robot; the page arms, drives, disarms and stops it.

    Pictures and wishes have their time after the command of a tick was sent, at most 60 and 200 times a second.

    Args:
        session: ready to run.
        link: to the viewer.
    """

    def __init__(self, session: DeploymentSession, link: Link) -> None:
        controller, self._operator = session.controller, session.operator
        gaits = tuple(controller.feet.gaits)
        controller.commands = self._commands = PageCommands(gaits, plans=session.config.mpc.enabled)
        self._operator.listen = self._listen
        super().__init__(session.config, session, link, deployed=True)

    @property
    def _halted(self) -> bool:
        """Whether the robot is disarmed."""
        return not self._operator.armed

    def _listen(self) -> None:
        """Fulfil wishes while there are no ticks that do."""
        now = perf_counter()
        if now - self._asked_at > PICTURE_S:
            self._asked_at = now
            self._answer()

    def _fulfil(self, wish: Any) -> None:
        operator = self._operator
        if isinstance(wish, CommandEntry):
            self._commands.ask(wish)
        elif isinstance(wish, Order):
            if wish.name == "stop":
                operator.stop = "emergency stop on the page"
            elif wish.name == "lie":
                operator.lies = True
            else:
                operator.armed = wish.name == "arm"
        else:
            self._link.send(Note("a robot at the end of a link has no such control", error=True))


def deployed_config(
    config: Config,
    driver: Callable[[Robot], Driver],
    out: str | Path = "runs",
    *,
    link: Link,
    notify: Notify = ignore,
    progress: ProgressReport = ignore,
    operator: Operator | None = None,
    dry_run: bool = False,
) -> tuple[FinishedRun, Deployment]:
    """Run the controllers of ``config`` on a robot, driven from a page; see ``lgmpc.config.deploying.deploy_config``.

    Commands of the config are left out, and nothing is sent before the robot is armed.

    Args:
        config: the closed loop.
        driver: constructs the driver of the robot.
        out: folder of run folders.
        link: to the page, from :meth:`lgmpc.live.viewing.Viewing.open`.
        notify: called with a description of what is being prepared.
        progress: called with the progress of the run.
        operator: the person at the terminal; none unless given.
        dry_run: whether nothing is sent to the robot.

    Returns:
        The run, and the figures of link and loop.
    """
    shown: list[DeployedRun] = []
    try:
        finished, deployment = deploy_config(
            config.replace({"commands": (), "changes": ()}),
            driver,
            out,
            notify=notify,
            progress=progress,
            operator=Operator(armed=False) if operator is None else operator,
            dry_run=dry_run,
            prepared=lambda session: shown.append(DeployedRun(session, link)),
        )
    finally:
        for each in shown:
            each.close()
    ending = deployment.failure or deployment.ending.value
    link.send(Note(f"{ending}; saved in {finished.folder.path}", error=bool(deployment.failure), over=True))
    return finished, deployment
