"""The limits that a run keeps to pass."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from lgmpc.settings import Finite, Fraction, NonNegative, Settings

__all__ = ["Gate"]

Number = Annotated[int, Field(strict=True, ge=0)]


class Gate(Settings):
    """Limits on a run's metrics. A robot that falls fails every gate.

    Each limit is a number, or null where there is none. Tilt, base height, torque limits and solver failures are
    limited by default: a robot that hangs by its limits has not balanced, even if it has not fallen.
    """

    steady_from_s: NonNegative = Field(
        default=0.0, description="From when on tracking errors and joint speeds count, s; itself no limit."
    )
    max_tilt_deg: NonNegative | None = Field(default=20.0, description="Largest tilt of the base, degrees.")
    max_displacement_m: NonNegative | None = Field(
        default=None, description="Largest distance of the base from its start, m."
    )
    min_base_height_m: NonNegative | None = Field(default=None, description="Lowest height of the base, m.")
    min_base_height_fraction: Fraction | None = Field(
        default=0.7, description="Lowest height of the base as a share of its first height, 0 to 1."
    )
    max_final_position_error_m: NonNegative | None = Field(
        default=None, description="Distance of the base from its start at the end, m."
    )
    max_final_tilt_deg: NonNegative | None = Field(default=None, description="Tilt of the base at the end, degrees.")
    max_final_rotation_deg: NonNegative | None = Field(
        default=None, description="Rotation of the base from its start, yaw included, at the end, degrees."
    )
    max_slip_m: NonNegative | None = Field(
        default=None, description="Largest distance that a foot slides while it is in contact, m."
    )
    max_foot_displacement_m: NonNegative | None = Field(
        default=None, description="Largest distance of a foot from its start, m."
    )
    max_abs_torque_nm: NonNegative | None = Field(default=None, description="Largest torque at any joint, N.m.")
    max_torque_saturation_fraction: Fraction | None = Field(
        default=0.1, description="Share of ticks with a joint at its torque limit, 0 to 1."
    )
    min_friction_margin_n: Finite | None = Field(
        default=None, description="Smallest distance of a measured force from the friction cone's surface, N."
    )
    max_rms_joint_velocity_rad_s: NonNegative | None = Field(
        default=None, description="RMS of the joint speeds from steady_from_s on, rad/s."
    )
    max_com_rms_error_m: NonNegative | None = Field(
        default=None, description="RMS distance of the centre of mass from its target from steady_from_s on, m."
    )
    max_com_error_m: NonNegative | None = Field(
        default=None, description="Largest distance of the centre of mass from its target from steady_from_s on, m."
    )
    max_solver_failures: Number | None = Field(
        default=0, description="MPC updates and whole-body ticks whose solver failed."
    )
    max_deadline_misses: Number | None = Field(
        default=None, description="MPC updates and whole-body ticks that took longer than their period."
    )
    max_mpc_p50_ms: NonNegative | None = Field(default=None, description="Median duration of an MPC update, ms.")
    max_wbc_p50_ms: NonNegative | None = Field(default=None, description="Median duration of a whole-body tick, ms.")
    min_real_time_factor: NonNegative | None = Field(
        default=None, description="Simulated seconds per second of computing."
    )

    @property
    def limits(self) -> dict[str, float]:
        """The limits that are set, by their keys."""
        return {name: value for name, value in self if name != "steady_from_s" and value is not None}
