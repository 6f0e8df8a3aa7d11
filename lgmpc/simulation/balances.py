"""Momentum, energy and weight of the simulated robot, by its own masses, for checks of a run against Newton's laws."""

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.simulation.parameters import PlantSettings, simulated_model
from lgmpc.typing import Array


def momentum_and_energy(robot: Robot, settings: PlantSettings, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return the linear momentum and the mechanical energy, rotors included, of the simulated robot, and its weight.

    Args:
        robot: the controllers' model.
        settings: parameters in which the simulated robot differs.
        q: (k, nq) configurations.
        v: (k, nv) velocities.

    Returns:
        (k, 3) momenta, N.s, world axes, (k,) energies, J, and the (3,) weight, N, world axes.
    """
    model = simulated_model(robot, settings)
    data = model.createData()
    momentum, energy = np.empty((len(q), 3)), np.empty(len(q))
    for i, (position, velocity) in enumerate(zip(q, v, strict=True)):
        pin.computeCentroidalMomentum(model, data, position, velocity)
        momentum[i] = data.hg.linear
        # Not computeKineticEnergy: in Pinocchio 4.1 it leaves out the rotors of some joints (five of ANYmal's twelve).
        upper = np.triu(pin.crba(model, data, position))
        kinetic = velocity @ upper @ velocity - 0.5 * np.diag(upper) @ velocity**2
        energy[i] = kinetic + pin.computePotentialEnergy(model, data, position)
    weight: Array = sum(body.mass for body in model.inertias[1:]) * np.array(model.gravity.linear)
    return momentum, energy, weight
