import math

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError, ModelError
from lgmpc.robot import RobotSpec, load_robot
from lgmpc.simulation import make_plant
from lgmpc.simulation.parameters import PlantSettings, simulated_model


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("friction", 0.0),
        ("friction", -0.1),
        ("friction", math.nan),
        ("friction", "0.6"),
        ("friction", True),
        ("friction", 16e3),
        ("rate_hz", 0.0),
        ("rate_hz", math.inf),
        ("mass_scale", 0.0),
        ("mass_scale", -1.0),
        ("base_added_mass_kg", -0.5),
        ("joint_friction_nm", -0.01),
        ("joint_damping_nms", -0.01),
        ("joint_damping_nms", math.nan),
        ("base_com_offset_m", (0.0, 0.0)),
        ("integrator", "heun"),
    ],
)
def test_a_bad_value_is_refused_by_name(name, value):
    with pytest.raises(InputError, match=f"^{name}: got"):
        PlantSettings(**{name: value})


def test_the_integrator_is_mujocos():
    with pytest.raises(InputError, match="^integrator: got the text 'rk4'; expected no choice"):
        PlantSettings(kind="pinocchio", integrator="rk4")


def test_simulated_masses(solo12):
    params = PlantSettings(mass_scale=1.5, base_added_mass_kg=0.7, base_com_offset_m=(0.01, 0.02, -0.03))
    before = [inertia.copy() for inertia in solo12.model.inertias]
    model = simulated_model(solo12, params)
    assert pin.computeTotalMass(model) == pytest.approx(1.5 * solo12.mass + 0.7, rel=1e-14)
    np.testing.assert_allclose(model.inertias[1].lever, before[1].lever + (0.01, 0.02, -0.03), atol=1e-16)
    # A point mass at the centre of mass adds nothing to the moments about it.
    np.testing.assert_allclose(model.inertias[1].inertia, 1.5 * before[1].inertia, rtol=1e-14)
    np.testing.assert_allclose(model.inertias[3].matrix(), 1.5 * before[3].matrix(), rtol=1e-12, atol=1e-18)
    # The controller's model is another one, and stays as it was.
    assert all(np.array_equal(a.matrix(), b.matrix()) for a, b in zip(solo12.model.inertias, before, strict=True))


@pytest.mark.parametrize("kind", ["mujoco", "pinocchio"])
def test_bodies_without_inertia_are_one_error_that_names_them(kind) -> None:
    limits = {"effort_limit_nm": 50.0, "velocity_limit_rad_s": 10.0, "armature_kg_m2": 0.1}
    robot = load_robot(RobotSpec(model="icub_reduced", contact_frames=("l_sole", "r_sole"), **limits))
    with pytest.raises(
        ModelError, match="no inertia .*: links behind joints r_hip_pitch, r_hip_roll, .*r_wrist_pitch;"
    ):
        make_plant(robot, PlantSettings(kind=kind))
