"""Simulation: plants, their parameters, sensors, disturbances, and the closed loop.

Two plants implement one protocol: :class:`PinocchioPlant`, and :class:`lgmpc.simulation.mujoco.MujocoPlant`, which
is not named here because it loads MuJoCo.
"""

from lgmpc.simulation.disturbances import Push as Push, PushSchedule as PushSchedule
from lgmpc.simulation.loop import (
    Disturbance as Disturbance,
    Loop as Loop,
    Sensing as Sensing,
    Tick as Tick,
    control_ticks as control_ticks,
    true_state as true_state,
)
from lgmpc.simulation.parameters import PlantSettings as PlantSettings
from lgmpc.simulation.pinocchio import PinocchioPlant as PinocchioPlant
from lgmpc.simulation.plant import Plant as Plant, PlantSample as PlantSample, make_plant as make_plant
from lgmpc.simulation.sensors import SensorNoise as SensorNoise, Sensors as Sensors
