"""Geometric phases: rotation by changes of shape, and the phase of a free rigid body (chapter 4.16).

Half a turn of a cat about its spine, without angular momentum::

    cat = Cat()
    cat.connection().holonomy(flip(cat.flipping_bend()))
"""

from lgmpc.mechanics.phases.cat import Cat, flip
from lgmpc.mechanics.phases.connection import Connection, KineticEnergy, Loop, circle
from lgmpc.mechanics.phases.elroy import Beanie
from lgmpc.mechanics.phases.rigid_body import RigidBodyPhase, rigid_body_phase
from lgmpc.mechanics.phases.three_link import ThreeLink

__all__ = [
    "Beanie",
    "Cat",
    "Connection",
    "KineticEnergy",
    "Loop",
    "RigidBodyPhase",
    "ThreeLink",
    "circle",
    "flip",
    "rigid_body_phase",
]
