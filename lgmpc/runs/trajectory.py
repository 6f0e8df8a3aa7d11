"""The arrays of a solved problem: the trajectory, its forces and waypoints, the solver's iterations."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError
from lgmpc.runs.channels import ArrayFile, channel, channels_of, described
from lgmpc.typing import Array, BoolArray

_array = partial(channel, "array")  # axes of the same name have equal lengths
_TABLES = ("nodes", "intervals", "iterations")


@described
@dataclass(frozen=True, kw_only=True)
class TrajectoryLog(ArrayFile):
    """A trajectory of N intervals with nc contacts, found in i iterations. World axes, SI units, read-only arrays.

    Attributes:
        control_unit: of all controls.
        nq: size of the configuration.
        floating_base: whether the configuration begins with a base pose.
        friction: coefficient of the contact forces' cones; NaN for a problem without.

    Raises:
        RunFolderError: arrays of inconsistent shapes.
    """

    times: Array = _array("of the nodes, not decreasing; an impact's two nodes have the same", "nodes", unit="s")
    xs: Array = _array("states [configuration; velocity]", "nodes", "nx")
    us: Array = _array("controls", "intervals", "nu")
    com: Array = _array("centre of mass", "nodes", 3, unit="m", frame="world")
    contact_points: Array = _array("positions of the contact points", "nodes", "nc", 3, unit="m", frame="world")
    contact_flags: BoolArray = _array("contacts with the ground in each interval", "intervals", "nc", dtype=np.bool_)
    contact_forces: Array = _array("forces on the robot", "intervals", "nc", 3, unit="N", frame="world")
    contact_frames: NDArray[np.str_] = _array("names of the contact frames", "nc", dtype=np.str_)
    control_names: NDArray[np.str_] = _array("names of the controls", "nu", dtype=np.str_)
    control_lower: Array = _array("lower limits; minus infinity where unknown", "nu")
    control_upper: Array = _array("upper limits; infinity where unknown", "nu")
    waypoint_names: NDArray[np.str_] = _array("frames or bodies with targets", "waypoints", dtype=np.str_)
    waypoint_times: Array = _array("times of the targets", "waypoints", unit="s")
    waypoint_positions: Array = _array("positions of the targets", "waypoints", 3, unit="m", frame="world")
    waypoint_rotations: Array = _array("world from frame; NaN for a position only", "waypoints", 3, 3, frame="world")
    iteration_cost: Array = _array("cost after each iteration", "iterations")
    iteration_criterion: Array = _array(
        "the measure compared with the tolerance; NaN where it is not reported", "iterations"
    )
    iteration_gap: Array = _array("largest gap of the dynamics at the start of each iteration", "iterations")
    iteration_step: Array = _array(
        "length of the step; 0 where none was accepted, NaN where it is not reported", "iterations"
    )
    iteration_regularization: Array = _array("regularisation of the backward sweep", "iterations")
    iteration_elapsed: Array = _array("since the solver began", "iterations", unit="s")
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

    def tables(self) -> dict[str, list[str]]:
        """Return the channels of nodes, intervals and iterations."""
        found = channels_of(TrajectoryLog, "array")
        return {axis: [n for n, each in found.items() if each.axes[0] == axis] for axis in _TABLES}

    def names_along(self) -> dict[str, list[str]]:
        """Return the names of entries along the axes nu and nc."""
        return {"nu": self.control_names.tolist(), "nc": self.contact_frames.tolist()}

    @property
    def nodes(self) -> int:
        """Number of intervals N."""
        return len(self.us)

    @property
    def finite(self) -> bool:
        """Whether all states and controls are finite."""
        return bool(np.isfinite(self.xs).all() and np.isfinite(self.us).all())
