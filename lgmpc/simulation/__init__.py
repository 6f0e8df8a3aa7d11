"""Simulated worlds: the plants, their parameters, sensors, disturbances, and the loop that drives them.

Two plants stand behind one protocol: :class:`PinocchioPlant`, and :class:`lgmpc.simulation.mujoco.MujocoPlant`, which
is not named here because it loads MuJoCo.
"""

from lgmpc.simulation.disturbances import Push, PushSchedule
from lgmpc.simulation.loop import Disturbance, Rates, Sensing, Tick, simulate, true_state
from lgmpc.simulation.parameters import SOLO12_GEOMETRY, BodyGeometry, PlantParameters
from lgmpc.simulation.pinocchio import PinocchioPlant
from lgmpc.simulation.plant import Plant, PlantSample
from lgmpc.simulation.sensors import SensorNoise, Sensors

__all__ = [
    "SOLO12_GEOMETRY",
    "BodyGeometry",
    "Disturbance",
    "PinocchioPlant",
    "Plant",
    "PlantParameters",
    "PlantSample",
    "Push",
    "PushSchedule",
    "Rates",
    "SensorNoise",
    "Sensing",
    "Sensors",
    "Tick",
    "simulate",
    "true_state",
]
