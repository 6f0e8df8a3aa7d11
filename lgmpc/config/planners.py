"""From section ``mpc`` of a config to the predictive layer of the controller: one builder for each model."""

from __future__ import annotations

from typing import Any

from lgmpc.config.schema import Config
from lgmpc.config.schema.mpc import (
    CentroidalMpcSection,
    FullBodyMpcSection,
    KinodynamicMpcSection,
    LqrMpcSection,
    MpcSection,
)
from lgmpc.config.session import Notify
from lgmpc.control.planner import Planner, PlannerSettings
from lgmpc.control.prediction import CentroidalPredictor, Predictor, WholeBodyPredictor
from lgmpc.control.reference import ComReference
from lgmpc.estimation import WrenchObserver
from lgmpc.mpc import (
    CentroidalLqr,
    CentroidalMpc,
    CentroidalMpcSettings,
    CentroidalWeights,
    FullBodyMpc,
    FullBodyMpcSettings,
    FullBodyWeights,
    KinodynamicMpc,
    KinodynamicMpcSettings,
    KinodynamicWeights,
    LqrSettings,
)
from lgmpc.robot import Robot
from lgmpc.robot.scaling import normal_force_range, weight_factor

__all__ = ["build_planner"]

_NORMAL_FORCE = (0.2, 12.0)
"""N per kg of the robot: the plan unloads no foot entirely."""
_CREDIBLE_PUSH = 3.0
"""Weights of the robot: what the observer takes for a stronger push than this is a fault."""
_SCALED = ("linear_momentum", "angular_momentum", "force", "effort")
"""Weights that are for a robot of 2.5 kg."""


def build_planner(config: Config, robot: Robot, reference: ComReference, notify: Notify) -> Planner:
    """Return the predictive layer of section ``mpc``; compiles it if it never was on this machine."""
    section, period = config.mpc, 1.0 / config.wbc.rate_hz
    observer = WrenchObserver(period, section.observer_time_s, force_limit=_CREDIBLE_PUSH * robot.mass * 9.81)
    following = PlannerSettings(
        every=round(config.wbc.rate_hz / section.rate_hz), wrench_decay_time=section.wrench_decay_s
    )
    return Planner(_predictor(section, robot, notify), observer, reference, period, following)


def _predictor(section: MpcSection, robot: Robot, notify: Notify) -> Predictor:
    horizon, weights = _horizon(section, robot), _weights(section, robot)
    if isinstance(section, FullBodyMpcSection):
        full = FullBodyMpcSettings(**horizon, reach=section.reach_rad, weights=FullBodyWeights(**weights))
        return WholeBodyPredictor(FullBodyMpc(robot, full, notify), robot, _stand_in(section, robot, notify))
    if isinstance(section, KinodynamicMpcSection):
        kinodynamic = KinodynamicMpcSettings(**horizon, reach=section.reach_rad, weights=KinodynamicWeights(**weights))
        mpc = KinodynamicMpc(robot, kinodynamic, notify)
        return WholeBodyPredictor(mpc, robot, _stand_in(section, robot, notify))
    if isinstance(section, LqrMpcSection):
        lqr = LqrSettings(**horizon, weights=CentroidalWeights(**weights))
        return CentroidalPredictor(
            CentroidalLqr(robot.mass, robot.nc, lqr, gravity=robot.gravity), section.uprighting_rate_hz
        )
    return _centroidal(section, robot, notify)


def _stand_in(section: MpcSection, robot: Robot, notify: Notify) -> CentroidalPredictor:
    """The centroidal model over the same horizon with the same limits, with its own weights."""
    shared = section.model_dump(include=set(CentroidalMpcSection.model_fields) - {"model", "weights"})
    return _centroidal(CentroidalMpcSection(**shared), robot, notify)


def _centroidal(section: CentroidalMpcSection, robot: Robot, notify: Notify) -> CentroidalPredictor:
    settings = CentroidalMpcSettings(**_horizon(section, robot), weights=CentroidalWeights(**_weights(section, robot)))
    mpc = CentroidalMpc(robot.mass, robot.nc, settings, gravity=robot.gravity, progress=notify)
    return CentroidalPredictor(mpc, section.uprighting_rate_hz)


def _horizon(section: MpcSection, robot: Robot) -> dict[str, Any]:
    """What :class:`lgmpc.mpc.MpcSettings` takes."""
    lowest, highest = normal_force_range(section.normal_force_n, _NORMAL_FORCE, robot.mass)
    horizon: dict[str, Any] = {
        "nodes": section.nodes,
        "node_duration": section.node_s,
        "friction": section.friction,
        "normal_force_min": lowest,
        "normal_force_max": highest,
    }
    if isinstance(section, LqrMpcSection):
        return horizon
    return {
        **horizon,
        "facets": section.friction_facets,
        "qp_solver": section.qp_solver,
        "sqp_iterations": section.sqp_iterations,
    }


def _weights(section: MpcSection, robot: Robot) -> dict[str, Any]:
    """The weights, called as in :mod:`lgmpc.mpc.settings`, those that depend on mass scaled."""
    factor = weight_factor(robot.mass)
    return {name: factor * value if name in _SCALED else value for name, value in section.weights}
