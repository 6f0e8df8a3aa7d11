"""The arrays of a solved problem: the trajectory, its forces and waypoints, the solver's iterations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError
from lgmpc.runs.channels import ArrayFile, channel, channels_of
from lgmpc.typing import Array, BoolArray

__all__ = ["TrajectoryLog"]


_array = partial(channel, "array")  # axes of the same name have equal lengths


@dataclass(frozen=True, kw_only=True)
class TrajectoryLog(ArrayFile):
    """A trajectory of N intervals with nc contacts, found in i iterations. World axes, SI units, read-only arrays.

    Attributes:
        times: (N+1,) of the nodes, s, not decreasing; an impact's two nodes have the same.
        xs: (N+1, nx) states [configuration; velocity].
        us: (N, nu) controls.
        com: (N+1, 3) centre of mass, m.
        contact_points: (N+1, nc, 3) positions of the contact points, m.
        contact_flags: (N, nc) contacts with the ground in each interval.
        contact_forces: (N, nc, 3) forces on the robot, N.
        contact_frames: (nc,) names of the contact frames.
        control_names: (nu,) names of the controls.
        control_lower: (nu,) lower limits; minus infinity where unknown.
        control_upper: (nu,) upper limits; infinity where unknown.
        waypoint_names: (w,) frames or bodies with targets.
        waypoint_times: (w,) times of the targets, s.
        waypoint_positions: (w, 3) m.
        waypoint_rotations: (w, 3, 3) world from frame; NaN for a position only.
        iteration_cost: (i,) cost after each iteration.
        iteration_criterion: (i,) the measure compared with the tolerance; NaN where it is not reported.
        iteration_gap: (i,) largest gap of the dynamics at the start of each.
        iteration_step: (i,) length of the step; 0 where none was accepted, NaN where it is not reported.
        iteration_regularization: (i,) regularisation of the backward sweep.
        iteration_elapsed: (i,) s since the solver began.
        control_unit: of all controls.
        nq: size of the configuration.
        floating_base: whether the configuration begins with a base pose.
        friction: coefficient of the contact forces' cones; NaN for a problem without.

    Raises:
        RunFolderError: arrays of inconsistent shapes.
    """

    times: Array = _array("nodes")
    xs: Array = _array("nodes", "nx")
    us: Array = _array("intervals", "nu")
    com: Array = _array("nodes", 3)
    contact_points: Array = _array("nodes", "nc", 3)
    contact_flags: BoolArray = _array("intervals", "nc", dtype=np.bool_)
    contact_forces: Array = _array("intervals", "nc", 3)
    contact_frames: NDArray[np.str_] = _array("nc", dtype=np.str_)
    control_names: NDArray[np.str_] = _array("nu", dtype=np.str_)
    control_lower: Array = _array("nu")
    control_upper: Array = _array("nu")
    waypoint_names: NDArray[np.str_] = _array("waypoints", dtype=np.str_)
    waypoint_times: Array = _array("waypoints")
    waypoint_positions: Array = _array("waypoints", 3)
    waypoint_rotations: Array = _array("waypoints", 3, 3)
    iteration_cost: Array = _array("iterations")
    iteration_criterion: Array = _array("iterations")
    iteration_gap: Array = _array("iterations")
    iteration_step: Array = _array("iterations")
    iteration_regularization: Array = _array("iterations")
    iteration_elapsed: Array = _array("iterations")
    control_unit: str
    nq: int
    floating_base: bool
    friction: float = np.nan

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name, each in channels_of(TrajectoryLog, "array").items():
            each.check(name, getattr(self, name), sizes)
        if sizes["nodes"] != sizes["intervals"] + 1:
            raise RunFolderError(f"{sizes['nodes']} states do not fit {sizes['intervals']} controls")
        if not (np.isfinite(self.times).all() and (np.diff(self.times) >= 0.0).all()):
            raise RunFolderError("'times' decreases")
        if not 0 <= self.nq <= sizes["nx"] or (self.floating_base and self.nq < 7):
            raise RunFolderError(f"nq = {self.nq} does not fit {sizes['nx']} entries of the state")

    def __repr__(self) -> str:
        return f"TrajectoryLog({self.nodes} intervals, {self.times[-1]:g} s, {len(self.iteration_cost)} iterations)"

    @property
    def nodes(self) -> int:
        """Number of intervals N."""
        return len(self.us)

    @property
    def finite(self) -> bool:
        """Whether all states and controls are finite."""
        return bool(np.isfinite(self.xs).all() and np.isfinite(self.us).all())
