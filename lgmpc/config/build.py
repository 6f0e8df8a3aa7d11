"""From a config to the objects it describes. The only file that knows every room."""

from __future__ import annotations

from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import Config
from lgmpc.config.schema.wbc import WbcGain
from lgmpc.config.sensing import build_estimator, build_sensors
from lgmpc.config.session import Notify, Session
from lgmpc.control.balance import BalanceController
from lgmpc.control.planner import Planner
from lgmpc.estimation import FrictionMonitor
from lgmpc.mpc import make_mpc
from lgmpc.robot import Robot
from lgmpc.robot.scaling import normal_force_range, weight_factor
from lgmpc.runs import Recorder
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Rates
from lgmpc.simulation.parameters import PlantParameters
from lgmpc.simulation.plant import Plant
from lgmpc.wbc import Gain, WholeBodyController, WholeBodyLimits, WholeBodySettings

__all__ = [
    "build_controller",
    "build_plant",
    "build_robot",
    "prepare",
]

_WBC_NORMAL_FORCE = (0.04, 10.0)
"""N per kg of the robot: a foot presses a little, and can carry the whole robot."""


def build_plant(config: Config, robot: Robot) -> Plant:
    """Return the simulated world of section ``plant``; the engine is imported only here."""
    section = config.plant
    parameters = PlantParameters(
        timestep=1.0 / section.rate_hz,
        friction=section.friction,
        mass_scale=section.mass_scale,
        base_added_mass=section.base_added_mass_kg,
        base_com_offset=section.base_com_offset_m,
        joint_friction=section.joint_friction_nm,
        joint_damping=section.joint_damping_nms,
    )
    if section.kind == "pinocchio":
        from lgmpc.simulation.pinocchio import PinocchioPlant

        return PinocchioPlant(robot, parameters)
    from lgmpc.simulation.mujoco import MujocoPlant

    return MujocoPlant(robot, parameters)


def build_whole_body_controller(config: Config, robot: Robot) -> WholeBodyController:
    """Return the whole-body controller of section ``wbc``."""
    section, weights, gains = config.wbc, config.wbc.weights, config.wbc.gains
    normal_force = normal_force_range(section.normal_force_n, _WBC_NORMAL_FORCE, robot.mass)
    limits = WholeBodyLimits(
        friction=section.friction,
        friction_facets=section.friction_facets,
        normal_force_min=normal_force[0],
        normal_force_max=normal_force[1],
        joint_horizon=section.joint_horizon_s,
        joint_acceleration_max=section.joint_acceleration_max_rad_s2,
    )
    settings = WholeBodySettings(
        limits=limits,
        com_weight=weights.com,
        com_gain=_gain(gains.com),
        base_orientation_weight=weights.base_orientation,
        base_orientation_gain=_gain(gains.base_orientation),
        base_position_weight=weights.base_position,
        base_position_gain=_gain(gains.base_position),
        angular_momentum_weight=weight_factor(robot.mass) * weights.angular_momentum,
        angular_momentum_gain=gains.angular_momentum,
        posture_weight=weights.posture,
        posture_gain=_gain(gains.posture),
        stance_weight=weights.stance,
        stance_damping=gains.stance_damping,
        swing_weight=weights.swing,
        swing_gain=_gain(gains.swing),
        force_weight=weight_factor(robot.mass) * weights.force,
        acceleration_weight=weights.acceleration,
        tolerance=section.tolerance,
        max_iterations=section.max_iterations,
        fallback_damping=section.fallback_damping_nms,
    )
    return WholeBodyController(robot, settings)


def _gain(gain: WbcGain) -> Gain:
    return Gain.critically_damped(gain.kp) if gain.kd is None else Gain(gain.kp, gain.kd)


def build_controller(config: Config, robot: Robot, notify: Notify = lambda message: None) -> BalanceController:
    """Return the controller of sections ``mpc``, ``wbc`` and ``reference``."""
    period = 1.0 / config.wbc.rate_hz
    mpc = make_mpc(robot, config.mpc, notify) if config.mpc.enabled else None
    planner = Planner(robot, mpc, config.reference, period) if mpc is not None else None
    floor = FrictionMonitor(config.wbc.friction, period)
    return BalanceController(robot, build_whole_body_controller(config, robot), config.reference, floor, planner)


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
    plant = build_plant(config, robot)
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
