"""Simulation: plants, their parameters, sensors, disturbances, and the closed loop.

Two plants implement one protocol: :class:`PinocchioPlant`, and :class:`lgmpc.simulation.mujoco.MujocoPlant`, which
is not named here because it loads MuJoCo.
"""

from lgmpc.simulation.disturbances import Push, PushSchedule
from lgmpc.simulation.loop import Disturbance, Rates, Sensing, Tick, simulate, true_state
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.simulation.pinocchio import PinocchioPlant
from lgmpc.simulation.plant import Plant, PlantSample, make_plant
from lgmpc.simulation.sensors import SensorNoise, Sensors

__all__ = [
    "Disturbance",
    "PinocchioPlant",
    "Plant",
    "PlantSettings",
    "PlantSample",
    "Push",
    "PushSchedule",
    "Rates",
    "SensorNoise",
    "Sensing",
    "Sensors",
    "Tick",
    "make_plant",
    "simulate",
    "true_state",
]
