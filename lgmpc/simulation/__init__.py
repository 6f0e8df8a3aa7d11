"""Simulation: plants, their parameters, sensors, disturbances, and the closed loop.

Two plants implement one protocol: :class:`PinocchioPlant`, and :class:`lgmpc.simulation.mujoco.MujocoPlant`, which
is not named here because it loads MuJoCo.
"""

from lgmpc.robot import Robot
from lgmpc.simulation.disturbances import Push as Push, PushSchedule as PushSchedule
from lgmpc.simulation.loop import Loop as Loop, Tick as Tick, control_ticks as control_ticks
from lgmpc.simulation.parameters import PlantSettings as PlantSettings
from lgmpc.simulation.pinocchio import PinocchioPlant as PinocchioPlant
from lgmpc.simulation.plant import Plant as Plant
from lgmpc.simulation.sensors import SensorNoise as SensorNoise, Sensors as Sensors
from lgmpc.world import World


def make_plant(robot: Robot, settings: PlantSettings, world: World | None = None) -> Plant:
    """Return the plant of ``settings`` in a world, a level floor unless given; only its engine is imported."""
    if settings.kind == "pinocchio":
        return PinocchioPlant(robot, settings, world)
    from lgmpc.simulation.mujoco import MujocoPlant

    return MujocoPlant(robot, settings, world)
