"""From the config of a problem to solve to its scenario.

A new kind of problem takes three things:

1. ``lgmpc/problems/<kind>.py``: a frozen dataclass of settings and ``build_<kind>(robot, settings) -> Scenario``.
2. ``lgmpc/config/schema/problem/<kind>.py``: its section with ``kind: Literal["<kind>"]``, and one line in the union of
   ``lgmpc/config/schema/problem/__init__.py``. Then write the schema for editors: ``lgmpc schema --out
   configs/schema.json``.
3. Here: a function from section to settings, and one line in ``_KINDS``.

An :class:`InputError` of a builder about the argument ``radius`` is reported at the key ``problem.radius`` or, where
the key has a unit, ``problem.radius_m``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from lgmpc.config.robots import build_any_robot
from lgmpc.config.schema import SolveConfig
from lgmpc.config.schema.problem import (
    ComCircleProblem,
    FlightProblem,
    GaitProblem,
    JumpProblem,
    ProblemSection,
    ReachProblem,
    RecoveryProblem,
    RightingProblem,
    StandingReachProblem,
)
from lgmpc.config.schema.problem.legged import GaitWeightsSection, LeggedSection
from lgmpc.config.schema.problem.rotors import RotorsSection
from lgmpc.errors import ConfigError, InputError
from lgmpc.problems import (
    ComCircleSettings,
    ComCircleWeights,
    FlightSettings,
    FlightWaypoint,
    FlightWeights,
    GaitPhase,
    GaitSettings,
    JumpSettings,
    LeggedSettings,
    LeggedWeights,
    LegStrokes,
    MultirotorSettings,
    ReachSettings,
    ReachWeights,
    RecoverySettings,
    RecoveryWeights,
    RightingSettings,
    RightingWeights,
    Scenario,
    StandingReachSettings,
    StandingReachWeights,
    build_com_circle,
    build_flight,
    build_gait,
    build_jump,
    build_reach,
    build_recovery,
    build_righting,
    build_standing_reach,
)
from lgmpc.robot import Robot
from lgmpc.settings import Settings

__all__ = ["build_scenario", "problem_settings"]


def problem_settings(section: ProblemSection) -> Any:
    """Return what a section says in the words of :mod:`lgmpc.problems`, such as :class:`lgmpc.problems.GaitSettings`.

    Raises:
        InputError: a value that the settings refuse.
    """
    settings_of, _ = _KINDS[type(section)]
    return settings_of(section)


def build_scenario(config: SolveConfig) -> Scenario:
    """Load the robot and build the problem.

    Raises:
        ConfigError: a robot that does not exist, or a problem that this robot cannot have.
        ModelError: with everything that the model lacks.
    """
    robot = build_any_robot(config)
    try:
        _, build = _KINDS[type(config.problem)]
        return build(robot, problem_settings(config.problem))
    except InputError as error:
        raise _at_its_key(config, error) from error


def _com_circle(section: ComCircleProblem) -> ComCircleSettings:
    return ComCircleSettings(
        radius=section.radius_m,
        frequency=section.frequency_hz,
        nodes=section.nodes,
        node_duration=section.node_s,
        friction=section.friction,
        weights=ComCircleWeights(**section.weights.model_dump()),
    )


def _reach(section: ReachProblem) -> ReachSettings:
    return ReachSettings(
        frame=section.frame,
        position=section.position_m,
        rpy_deg=section.rpy_deg,
        nodes=section.nodes,
        node_duration=section.node_s,
        weights=ReachWeights(**section.weights.model_dump()),
    )


def _flight(section: FlightProblem) -> FlightSettings:
    return FlightSettings(
        rotors=_rotors(section.rotors),
        start=section.start_m,
        waypoints=tuple(FlightWaypoint(p.name, p.time_s, p.position_m, p.rotation_deg) for p in section.waypoints),
        node_duration=section.node_s,
        weights=FlightWeights(**section.weights.model_dump()),
    )


def _recovery(section: RecoveryProblem) -> RecoverySettings:
    return RecoverySettings(
        rotors=_rotors(section.rotors),
        position=section.position_m,
        rotation_deg=section.rotation_deg,
        velocity=section.velocity_m_s,
        angular_velocity=section.angular_velocity_rad_s,
        goal_rotation_deg=section.goal_rotation_deg,
        nodes=section.nodes,
        node_duration=section.node_s,
        weights=RecoveryWeights(**section.weights.model_dump()),
    )


def _righting(section: RightingProblem) -> RightingSettings:
    strokes = section.strokes
    return RightingSettings(
        strokes=LegStrokes(strokes.stretched_rad, strokes.folded_rad, strokes.sweep_rad, strokes.count, strokes.ramp_s),
        position=section.position_m,
        rotation_deg=section.rotation_deg,
        velocity=section.velocity_m_s,
        goal_rotation_deg=section.goal_rotation_deg,
        trunk_half_size=section.trunk_half_size_m,
        nodes=section.nodes,
        node_duration=section.node_s,
        weights=RightingWeights(**section.weights.model_dump()),
    )


def _gait(section: GaitProblem) -> GaitSettings:
    phases = tuple(GaitPhase(phase.duration_s, phase.air, phase.height_m) for phase in section.phases)
    return GaitSettings(
        pattern=phases if section.pattern is None else section.pattern,
        cycles=section.cycles,
        swing=section.swing_s,
        stance=section.stance_s,
        height=section.height_m,
        velocity=section.velocity_m_s,
        yaw_rate=math.radians(section.yaw_rate_deg_s),
        settle=section.settle_s,
        ramp=section.ramp_s,
        common=_legged(section, section.weights),
    )


def _jump(section: JumpProblem) -> JumpSettings:
    return JumpSettings(
        displacement=section.displacement_m,
        yaw=math.radians(section.yaw_deg),
        takeoff=section.takeoff_s,
        flight=section.flight_s,
        landing=section.landing_s,
        height=section.height_m,
        common=_legged(section, section.weights),
    )


def _legged(section: LeggedSection, weights: GaitWeightsSection) -> LeggedSettings:
    return LeggedSettings(
        step=section.step_s,
        friction=section.friction,
        friction_margin=section.friction_margin,
        least_force=section.least_force,
        weights=LeggedWeights(**weights.model_dump()),
    )


def _standing_reach(section: StandingReachProblem) -> StandingReachSettings:
    return StandingReachSettings(
        frame=section.frame,
        position=section.position_m,
        rpy_deg=section.rpy_deg,
        sole_half_size=section.sole_half_size_m,
        sole_margin=section.sole_margin_m,
        friction=section.friction,
        nodes=section.nodes,
        node_duration=section.node_s,
        weights=StandingReachWeights(**section.weights.model_dump()),
    )


def _rotors(section: RotorsSection) -> MultirotorSettings:
    return MultirotorSettings(section.frames, section.turning, section.max_thrust_n, section.drag_ratio_m)


_KINDS: Mapping[type[Settings], tuple[Callable[[Any], Any], Callable[[Robot, Any], Scenario]]] = {
    ComCircleProblem: (_com_circle, build_com_circle),
    FlightProblem: (_flight, build_flight),
    GaitProblem: (_gait, build_gait),
    JumpProblem: (_jump, build_jump),
    ReachProblem: (_reach, build_reach),
    RecoveryProblem: (_recovery, build_recovery),
    RightingProblem: (_righting, build_righting),
    StandingReachProblem: (_standing_reach, build_standing_reach),
}
"""What turns each section into settings, and settings into a scenario."""


def _at_its_key(config: SolveConfig, error: InputError) -> ConfigError:
    """Say where in the config the argument that a builder refused comes from."""
    found = _key_of(type(config.problem), error.argument)
    key = f"problem.{found}" if found else "robot" if error.argument == "robot" else "problem"
    expected = error.expected if found or key == "robot" else f"{error.expected} ({error.argument})"
    return config.error(key, error.got, expected, error.choices)


def _key_of(section: type[Settings], argument: str) -> str | None:
    """Find the key of a section, or of a section within it, that is called as an argument, but for its unit."""
    fields = section.model_fields
    for key in sorted(fields, key=lambda key: key != argument):
        if key == argument or key.startswith(f"{argument}_"):
            return key
    for key, field in fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, Settings):
            inner = _key_of(field.annotation, argument)
            if inner is not None:
                return f"{key}.{inner}"
    return None
