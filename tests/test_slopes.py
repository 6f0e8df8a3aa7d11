"""Closed loops on inclined ground: the laws of physics hold there as on a level floor, on both plants."""

from __future__ import annotations

import pytest

from lgmpc.config import load_config
from lgmpc.config.build import prepare

PUSH = "pushes=[{body: base_link, time_s: 0.5, duration_s: 0.1, impulse_ns: [0.5, 0.5, 0]}]"


@pytest.mark.parametrize("kind", ["mujoco", "pinocchio"])
@pytest.mark.parametrize("uphill", [0, 90, 200])
def test_a_robot_pushed_on_a_slope_is_certified(kind: str, uphill: int) -> None:
    """Cones, penetration, and the balances of momentum and energy, for which no plane is special."""
    world = f"world={{kind: slope, angle_deg: 12, uphill_deg: {uphill}, start_yaw_deg: 30}}"
    session = prepare(load_config("solo12_balance", [world, PUSH, f"plant.kind={kind}", "duration_s=1.0"]))
    result = session.run(lambda progress: None)
    assert result.certificate is not None and result.certificate.certified, result.certificate
    assert {"friction", "momentum balance", "energy balance"} <= {each.name for each in result.certificate.checks}
    assert result.metrics is not None and not result.metrics.fell
    assert result.metrics.max_slip_m < 2e-3 and result.metrics.max_tilt_deg < 3.0
    # The desired height is vertical, the judged one along the normal: the ratio is the cosine of 12 degrees, 0.978.
    assert result.metrics.min_base_height_fraction == pytest.approx(0.978, abs=5e-3)
