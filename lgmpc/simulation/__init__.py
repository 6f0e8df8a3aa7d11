"""Simulated worlds: the plants, their parameters, sensors, disturbances, and the loop that drives them.

Two plants stand behind one protocol: :class:`PinocchioPlant`, and :class:`lgmpc.simulation.mujoco.MujocoPlant`, which
is not named here because it loads MuJoCo.
"""

from lgmpc.simulation.control import Command
from lgmpc.simulation.disturbances import Push, PushSchedule
from lgmpc.simulation.loop import Controller, Disturbance, Estimator, Rates, Sensing, Tick, simulate
from lgmpc.simulation.parameters import SOLO12_GEOMETRY, BodyGeometry, PlantParameters
from lgmpc.simulation.pinocchio import PinocchioPlant
from lgmpc.simulation.plant import Plant, PlantSample
from lgmpc.simulation.sensors import SensorNoise, SensorReading, Sensors

__all__ = [
    "SOLO12_GEOMETRY",
    "BodyGeometry",
    "Command",
    "Controller",
    "Disturbance",
    "Estimator",
    "PinocchioPlant",
    "Plant",
    "PlantParameters",
    "PlantSample",
    "Push",
    "PushSchedule",
    "Rates",
    "SensorNoise",
    "SensorReading",
    "Sensing",
    "Sensors",
    "Tick",
    "simulate",
]
