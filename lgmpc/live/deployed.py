"""A robot at the end of a link that a page shows and drives, in place of the config's commands."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Any

from lgmpc.config.deploying import DeploymentSession, deploy_config
from lgmpc.config.execution import FinishedRun
from lgmpc.config.schema import Config
from lgmpc.hardware.deployment import Deployment, Driver
from lgmpc.hardware.safety import Operator
from lgmpc.live.ring import PICTURE_S
from lgmpc.live.session import PageCommands, Shown
from lgmpc.live.viewing import Link
from lgmpc.live.wishes import Note, Order
from lgmpc.locomotion.command import CommandEntry
from lgmpc.robot import Robot


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
        super().__init__(session.config, controller, session.recorder, link, deployed=True)
        session.watch = self.watch

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
    operator: Operator,
    **options: Any,
) -> tuple[FinishedRun, Deployment]:
    """Run the controllers of ``config`` on a robot, driven from a page, without the config's commands.

    Args:
        config: the closed loop.
        driver: constructs the driver of the robot.
        out: folder of run folders.
        link: to the page, from :meth:`lgmpc.live.viewing.Viewing.open`.
        operator: what the page orders is done through it: it begins disarmed.
        options: further ones of :func:`lgmpc.config.deploying.deploy_config`.

    Returns:
        The run, and the figures of link and loop.
    """
    config = config.replace({"commands": (), "changes": ()})
    with ExitStack() as shown:

        def prepared(session: DeploymentSession) -> None:
            shown.callback(DeployedRun(session, link).close)

        finished, deployment = deploy_config(config, driver, out, operator=operator, prepared=prepared, **options)
    ending = deployment.failure or deployment.ending.value
    link.send(Note(f"{ending}; saved in {finished.folder.path}", error=bool(deployment.failure), over=True))
    return finished, deployment
