"""Report of one control tick, for whoever records, explains or shows what a controller does."""

from collections.abc import Sequence
from typing import NamedTuple

from lgmpc.control.modes import Mode
from lgmpc.locomotion.command import MotionCommand
from lgmpc.locomotion.contacts import ContactState
from lgmpc.locomotion.gait import Gait
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.mpc import Plan
from lgmpc.status import Status
from lgmpc.typing import Array, BoolArray


class TickReport(NamedTuple):
    """State, decisions and targets of a controller's last tick, in world axes.

    Arrays are the controller's own and change at its next update: copy what has to stay. A tuple with names is made
    faster than a frozen dataclass.

    Attributes:
        time: of the state, s.
        finite: whether the state was finite.
        mode: of the robot.
        command: the limited command.
        gait: followed or, of a robot at rest, standing.
        stance: (nf,) which feet carry.
        contact_states: (nf,) contacts relative to the schedule.
        contact_points: (nc, 3) sensed contact points, m.
        com: (3,) sensed centre of mass, m.
        momentum: (6,) sensed centroidal momentum [linear; angular].
        com_target: (3,) desired centre of mass, m.
        base_target: (7,) desired base pose [position, quaternion x y z w].
        foot_targets: (nc, 3) targets of the feet in the air, m.
        footholds: (nc, 3) where each foot stands or will touch down next, m.
        forces: (nc, 3) contact forces of the whole-body QP, N.
        external_wrench: (6,) estimated external [force; moment about the centre of mass], N and N.m.
        ground: the belief of it.
        motor_shares: (nu,) of its torque that each motor gives.
        joint_friction: (nu,) friction of the joints that the torques overcome, N.m.
        status: of the whole-body QP.
        plan: the last plan; None before the first.
        planned: whether it was made at this tick.
        tick_ms: duration of the update without the two that follow, ms.
        plan_ms: duration of planning, with the horizon's contacts and the sampling of the plan, ms; 0 at other ticks.
        forecast_ms: duration of forecasts of steps against a push, ms; 0 at other ticks.
    """

    time: float
    finite: bool
    mode: Mode
    command: MotionCommand
    gait: Gait
    stance: BoolArray
    contact_states: Sequence[ContactState]
    contact_points: Array
    com: Array
    momentum: Array
    com_target: Array
    base_target: Array
    foot_targets: Array
    footholds: Array
    forces: Array
    external_wrench: Array
    ground: TerrainBelief
    motor_shares: Array
    joint_friction: Array
    status: Status
    plan: Plan | None
    planned: bool
    tick_ms: float
    plan_ms: float
    forecast_ms: float
