"""From the config of a closed loop to the objects it describes. The only file that imports every room."""

from __future__ import annotations

import numpy as np

from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import Config, GroundTruth
from lgmpc.config.session import Notify, Session
from lgmpc.control.legged import LeggedController
from lgmpc.control.planner import Planner
from lgmpc.control.reference import StandReference
from lgmpc.errors import InputError
from lgmpc.estimation import FrictionMonitor, LeggedEstimator
from lgmpc.locomotion.command import CommandTimeline
from lgmpc.locomotion.settings import gaits_of
from lgmpc.mpc import make_mpc
from lgmpc.robot import Robot
from lgmpc.runs import Recorder
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Rates
from lgmpc.simulation.plant import make_plant
from lgmpc.simulation.sensors import Sensors
from lgmpc.wbc import WholeBodyController

__all__ = ["build_controller", "build_estimator", "build_robot", "build_sensors", "prepare"]


def build_sensors(config: Config, robot: Robot) -> Sensors:
    """Return the simulated sensors of section ``sensors``, their noise seeded by ``seed``."""
    return Sensors(robot, config.sensors, 1.0 / config.wbc.rate_hz, np.random.default_rng(config.seed))


def build_estimator(config: Config, robot: Robot, notify: Notify = lambda message: None) -> LeggedEstimator | None:
    """Return the estimator of section ``estimator``; None where the controllers receive the simulator's state."""
    if isinstance(config.estimator, GroundTruth):
        return None
    return LeggedEstimator(robot, 1.0 / config.wbc.rate_hz, config.estimator, progress=notify)


def build_controller(config: Config, robot: Robot, notify: Notify = lambda message: None) -> LeggedController:
    """Return the controller of sections ``mpc``, ``wbc``, ``locomotion``, ``commands`` and ``reference``.

    Raises:
        ConfigError: a command names a gait that does not exist, or a gait has not one offset for each foot.
    """
    period = 1.0 / config.wbc.rate_hz
    try:
        gaits = gaits_of(robot, config.locomotion)
        commands = CommandTimeline(config.commands, gaits=gaits)
    except InputError as error:
        raise config.error(error.argument, error.got, error.expected, error.choices) from error
    mpc = make_mpc(robot, config.mpc, notify) if config.mpc.enabled else None
    return LeggedController(
        robot,
        WholeBodyController(robot, config.wbc),
        FrictionMonitor(config.wbc.friction, period),
        Planner(robot, mpc, period) if mpc is not None else None,
        commands=commands,
        offset=None if isinstance(config.reference, StandReference) else config.reference,
        locomotion=config.locomotion,
        gaits=gaits,
        period=period,
    )


def prepare(config: Config, *, notify: Notify = lambda message: None) -> Session:
    """Build everything that a run needs.

    Args:
        config: what to run.
        notify: called with a description of what is being prepared.

    Raises:
        LgmpcError: what cannot be built, naming the key.
    """
    notify("loading the robot")
    robot = build_robot(config)
    plant = make_plant(robot, config.plant)
    controller = build_controller(config, robot, notify)
    estimator = build_estimator(config, robot, notify)
    rates = Rates.of(plant.dt, config.wbc.rate_hz, config.duration_s)
    mpc = config.mpc
    recorder = Recorder(
        nq=robot.nq,
        nv=robot.nv,
        effort_limit=robot.effort_limit,
        joint_names=robot.joint_names,
        estimated=estimator is not None,
        stepping=True,
        mass=config.plant.mass_scale * robot.mass + config.plant.base_added_mass_kg,
        contact_frames=robot.contact_frames,
        friction=config.plant.friction,
        contact_radius=robot.contact_radius,
        control_period_s=rates.period,
        ticks=rates.ticks,
        mpc_nodes=mpc.nodes if mpc.enabled else 0,
        mpc_period_s=1.0 / mpc.rate_hz if mpc.enabled else 0.0,
        mpc_updates=int(config.duration_s * mpc.rate_hz) + 1 if mpc.enabled else 0,
    )
    return ClosedLoopSession(
        robot=robot,
        plant=plant,
        controller=controller,
        pushes=PushSchedule(config.pushes, plant.dt, plant.bodies),
        rates=rates,
        recorder=recorder,
        log_every=round(config.wbc.rate_hz / config.log.rate_hz),
        gate=config.gate,
        sensors=None if estimator is None else build_sensors(config, robot),
        estimator=estimator,
    )
