"""Which speeds legs can follow, against the geometry of a stretched leg."""

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.locomotion.command import CommandEntry, CommandLimits
from lgmpc.locomotion.feasibility import infeasible_commands, top_speed
from lgmpc.locomotion.gait import Gait, quadruped_gaits
from lgmpc.locomotion.legs import LegGeometry
from tests.support.samples import solo8


def test_at_the_top_speed_the_legs_are_stretched_at_touchdown_and_lift_off(solo12) -> None:
    """Solo12's legs are stretched where the knee's angle is zero."""
    legs, gait = LegGeometry.of(solo12), quadruped_gaits()["trot"]
    model, data, q = solo12.model, solo12.model.createData(), solo12.q_reference.copy()
    pin.framesForwardKinematics(model, data, q)
    hip = model.getJointId("FL_HFE")
    drop = (data.oMi[hip].translation - data.oMf[solo12.contact_ids[0]].translation)[2] + solo12.contact_radius
    q[model.joints[model.getJointId("FL_KFE")].idx_q] = 0.0
    pin.framesForwardKinematics(model, data, q)
    length = np.linalg.norm(data.oMi[hip].translation - data.oMf[solo12.contact_ids[0]].translation)
    assert top_speed(legs, gait) == pytest.approx(2.0 * np.sqrt(length**2 - drop**2) / gait.stance_s, rel=1e-9)
    assert top_speed(legs, gait, length - drop) == pytest.approx(0.0, abs=1e-6)
    assert top_speed(legs, gait, -0.02) > top_speed(legs, gait)


def test_speeds_are_inverse_to_the_stance(solo12) -> None:
    legs = LegGeometry.of(solo12)
    short, long = (Gait(name="g", period_s=period, duty=0.5, offsets=(0.0, 0.5, 0.5, 0.0)) for period in (0.2, 0.6))
    assert top_speed(legs, short) == pytest.approx(3.0 * top_speed(legs, long))
    assert top_speed(legs, quadruped_gaits()["stand"]) == 0.0


@pytest.mark.parametrize(
    ("entry", "key"),
    [
        ({"velocity_m_s": (0.3, 0.1, 0.0)}, "commands.1.velocity_m_s"),
        ({"yaw_rate_rad_s": 0.4}, "commands.1.yaw_rate_rad_s"),
        ({"velocity_m_s": (-0.3, 0.0, 0.0), "yaw_rate_rad_s": 0.0, "height_m": 0.01}, None),
    ],
)
def test_legs_without_abduction_neither_step_sideways_nor_turn(solo12, entry, key) -> None:
    entries = [CommandEntry(at_s=0.5, gait="trot"), CommandEntry(at_s=1.0, **entry)]
    legs, gaits = LegGeometry.of(solo8()), quadruped_gaits()
    found = list(infeasible_commands(entries, gaits, CommandLimits(), legs, 0.7))
    assert [error.argument for error in found] == ([key] if key else [])
    assert all("no joint moves the feet sideways" in str(error) for error in found)
    assert not list(infeasible_commands(entries, gaits, CommandLimits(), LegGeometry.of(solo12), 0.7))
