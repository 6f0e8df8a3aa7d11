"""Environments of Gymnasium: the closed loop of a config, with MPC and whole-body controller inside.

An agent acts at ``rate_hz`` on what the controller takes, an action of zeros being the controller alone; between two
actions the whole loop runs at its full rates:

    import gymnasium
    import lgmpc.gym

    env = gymnasium.make("lgmpc/Solo12Velocity-v0", action="torque", overrides=["plant.base_added_mass_kg=0.8"])

Overrides of section ``plant`` make the simulated robot another one than the controller's model. Episodes of the same
seed and actions are bitwise the same, in any process; a reset builds the loop anew (0.1 s, without compilation).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lgmpc.config import load_config
from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.schema import Config
from lgmpc.control.interface import Command, RobotState
from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.lie import quaternion
from lgmpc.locomotion.command import MotionCommand
from lgmpc.runs.modes import FALL_HEIGHT_FRACTION, FALL_TILT_DEG
from lgmpc.simulation.loop import Loop, Tick
from lgmpc.timegrid import TimeGrid, periods_in
from lgmpc.typing import Array

try:
    import gymnasium
except ImportError as error:
    raise MissingDependencyError("gymnasium", "lgmpc.gym", 'pip install "lgmpc[gym]"') from error


ActionKind = Literal["command", "footholds", "torque", "gait"]

ACTIONS = {
    "command": "velocities added to the goal, which the controller is told: ahead and to the left 0.5 m/s, yaw rate 1"
    " rad/s",
    "footholds": "shift of the footholds of swings: for each foot ahead and to the left, base axes, 0.05 m",
    "torque": "torques added to the controller's: a tenth of each joint's limit, N.m",
    "gait": "period of the gait (30 %), clearance of swings (50 %), height of the base (0.03 m)",
}
"""Kinds of actions, all in [-1, 1]: quantities, each with the value of 1. Periods change at most once a cycle."""

_GOAL = ((-0.3, -0.3, -0.5), (0.8, 0.3, 0.5))
_SPEED_SCALE, _RATE_SCALE, _EFFORT = 0.25, 0.5, 0.02
_LEAST_CHANGE, _LARGEST = 0.05, 1e3


@dataclass
class _Driven:
    """A controller and command source on which an agent acts.

    Attributes:
        session: the loop.
        command: what the controller is told.
        torque: (nu,) added to its torques, N.m; None for none.
    """

    session: ClosedLoopSession
    command: MotionCommand
    torque: Array | None = None

    def at(self, t: float) -> MotionCommand:
        """Return the present command."""
        return self.command

    def update(self, state: RobotState) -> Command:
        """Return the controller's command with the agent's torques."""
        command = self.session.controller.update(state)
        return command if self.torque is None else command._replace(tau=command.tau + self.torque)


class LocomotionEnv(gymnasium.Env[Array, Array]):
    """A legged robot that is to move with a velocity, controlled by MPC and an agent.

    Observations are a Box of 64-bit numbers, named by ``observation_names``: goal (3), height of the base above the
    ground, the vertical in base axes (3), velocity of the base [linear; angular] in base axes (6), joint angles
    relative to the reference posture, joint rates, contacts of the schedule, sine and cosine of the time to the next
    lift-off of each foot in cycles, force and moment that the controller estimates to act from outside in weights and
    weights times height (6), and the last action. They are what the controller received: with an estimator its
    estimate. Numbers beyond a thousand are clipped.

    The reward of a step is ``0.75 exp(-(dv / 0.25)^2) + 0.25 exp(-(dw / 0.5)^2) - 0.02 |action|^2 / n``, with the
    errors of the true horizontal velocity, m/s, and yaw rate, rad/s, against the goal, and n entries of the action: 1
    at best. An episode is terminated by a fall, and truncated after ``episode_s``.

    Args:
        config: a closed loop: the name of a shipped one, a file, or a :class:`~lgmpc.config.Config`.
        action: what the agent acts on, see :data:`ACTIONS`.
        overrides: changes ``key=value`` of the config.
        rate_hz: actions a second; divides the rate of the whole-body controller.
        episode_s: duration of an episode, s.
        goal: ranges [lowest, highest] of the goal's velocities ahead and to the left, m/s, and yaw rate, rad/s, from
            which each episode draws; ``reset(options={"goal": [vx, vy, yaw_rate]})`` gives it.

    Attributes:
        config: of the loop.
        observation_names: of the entries of an observation.
        action_names: of the entries of an action.

    Raises:
        InputError: an unknown kind of action, or a rate that does not divide the controller's.
        MissingDependencyError: gymnasium is not installed.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        config: str | Path | Config = "solo12_velocity",
        action: ActionKind = "command",
        *,
        overrides: Sequence[str] = (),
        rate_hz: float = 50.0,
        episode_s: float = 10.0,
        goal: Sequence[Sequence[float]] = _GOAL,
    ) -> None:
        if action not in ACTIONS:
            raise InputError("action", action, "a kind of action", tuple(ACTIONS))
        loaded = config if isinstance(config, Config) else load_config(config, list(overrides))
        changes = {"duration_s": episode_s, "after_fall_s": None, "changes": (), "pushes": loaded.pushes}
        self.config = loaded.replace(changes)
        self._ticks = periods_in("rate_hz", rate_hz, "wbc.rate_hz", self.config.wbc.rate_hz)
        self._goal_range = np.array(goal, dtype=np.float64)
        if self._goal_range.shape != (2, 3) or not np.isfinite(self._goal_range).all():
            raise InputError("goal", goal, "[lowest, highest] of [ahead, left, yaw rate], finite")
        self._steps = TimeGrid(1.0 / rate_hz).nearest(episode_s)
        entries = [entry for entry in self.config.commands if entry.gait is not None]
        self._gait = str(entries[0].gait) if entries else "trot"
        self._kind = action
        session = prepare(self.config)
        assert isinstance(session, ClosedLoopSession)
        robot = session.robot
        feet = [str(name) for name in robot.contact_frames] if robot.foot_points.single else list(map(str, robot.feet))
        joints = list(robot.joint_names)
        self.action_names = {
            "command": ["vx", "vy", "yaw_rate"],
            "footholds": [f"{foot}.{axis}" for foot in feet for axis in ("ahead", "left")],
            "torque": joints,
            "gait": ["period", "clearance", "height"],
        }[action]
        names = {
            "goal": ["vx", "vy", "yaw_rate"],
            "base": ["height", *(f"up.{axis}" for axis in "xyz")],
            "v": [f"{part}.{axis}" for part in ("linear", "angular") for axis in "xyz"],
            "q": joints,
            "dq": joints,
            "stance": feet,
            "phase_sin": feet,
            "phase_cos": feet,
            "outside": [f"{part}.{axis}" for part in ("force", "moment") for axis in "xyz"],
            "action": self.action_names,
        }
        self.observation_names = [f"{group}.{name}" for group, each in names.items() for name in each]
        count, size = len(self.action_names), len(self.observation_names)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (count,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-_LARGEST, _LARGEST, (size,), np.float64)
        self._lowest = FALL_HEIGHT_FRACTION * float(robot.q_reference[2])
        self._limit = robot.effort_limit

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode: the loop anew, its first control tick computed.

        Args:
            seed: of goal and noise; the next of the environment's own random numbers unless given.
            options: ``goal``: velocities ahead and to the left, m/s, and yaw rate, rad/s.

        Raises:
            InputError: an unknown option, or a goal that is not three finite numbers.
        """
        super().reset(seed=seed)
        wanted = dict(options or {})
        drawn = self.np_random.uniform(*self._goal_range)
        self._goal = np.array(wanted.pop("goal", drawn), dtype=np.float64)
        if wanted or self._goal.shape != (3,) or not np.isfinite(self._goal).all():
            raise InputError("options", options, "goal, three finite numbers, and no other")
        session = prepare(self.config.replace({"seed": int(self.np_random.integers(2**31))}))
        assert isinstance(session, ClosedLoopSession)
        self._session, self._action = session, np.zeros(len(self.action_names))
        self._driven = _Driven(session, self._command(self._goal))
        session.controller.commands = self._driven
        self._loop = Loop(session.plant, self._driven, session.pushes, session.ticks, session.sensing, session.hardware)
        self._gaits = dict(session.controller.feet.gaits)
        self._clearance, self._changed_s = session.controller.feet.clearance, 0.0
        self._taken = 0
        self._run(1)
        return self._observation(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Act, and simulate until the next action.

        Args:
            action: (n,) in [-1, 1]; what is outside is clipped.

        Raises:
            InputError: an action that is not finite, or of another shape.
        """
        given = np.asarray(action, dtype=np.float64)
        if given.shape != self._action.shape or not np.isfinite(given).all():
            raise InputError(
                "action", action, f"{len(self.action_names)} finite numbers: {', '.join(self.action_names)}"
            )
        self._action = np.clip(given, -1.0, 1.0)
        getattr(self, f"_act_{self._kind}")(self._action)
        self._run(self._ticks)
        self._taken += 1
        velocity, rate = self._velocity()
        error, turning = float(np.linalg.norm(velocity - self._goal[:2])), abs(rate - self._goal[2])
        reward = 0.75 * math.exp(-((error / _SPEED_SCALE) ** 2)) + 0.25 * math.exp(-((turning / _RATE_SCALE) ** 2))
        reward -= _EFFORT * float(self._action @ self._action) / len(self._action)
        info = {"velocity_error_m_s": error, "yaw_rate_error_rad_s": float(turning)}
        return self._observation(), reward, self._fallen(), self._taken >= self._steps, info

    def _command(self, velocity: Array, height: float = 0.0) -> MotionCommand:
        vx, vy, yaw_rate = velocity.tolist()
        return MotionCommand(vx, vy, yaw_rate, height, gait=self._gait)

    def _run(self, ticks: int) -> None:
        def keep(tick: Tick) -> bool:
            self._tick = tick
            return True

        self._loop.run(keep, self._loop.index + ticks)

    def _act_command(self, action: Array) -> None:
        self._driven.command = self._command(self._goal + action * [0.5, 0.5, 1.0])

    def _act_footholds(self, action: Array) -> None:
        self._session.controller.feet.shifts = 0.05 * action.reshape(-1, 2)

    def _act_torque(self, action: Array) -> None:
        self._driven.torque = 0.1 * self._limit * action

    def _act_gait(self, action: Array) -> None:
        feet, time = self._session.controller.feet, self._tick.sample.time
        period, clearance, height = action.tolist()
        self._driven.command = self._command(self._goal, 0.03 * height)
        own, now = self._gaits[self._gait], feet.gaits[self._gait]
        gait = own.replace({"period_s": own.period_s * (1.0 + 0.3 * period)})
        if abs(gait.period_s - now.period_s) < _LEAST_CHANGE * now.period_s or time < self._changed_s + now.period_s:
            gait = now
        else:
            self._changed_s = time
        settings = feet.settings.replace({"swing.clearance_m": self._clearance * (1.0 + 0.5 * clearance)})
        feet.retune(settings, self._gaits | {self._gait: gait})

    def _velocity(self) -> tuple[Array, float]:
        """Return the true velocity (2,), m/s, in axes that turn with the heading, and the yaw rate, rad/s."""
        q, v = self._tick.sample.q, self._tick.sample.v
        world, turning = (quaternion.act(q[3:7], each) for each in (v[:3], v[3:6]))
        ahead = quaternion.act(q[3:7], np.array([1.0, 0.0, 0.0]))
        c, s = ahead[:2] / np.linalg.norm(ahead[:2])
        return np.array([c * world[0] + s * world[1], c * world[1] - s * world[0]]), float(turning[2])

    def _fallen(self) -> bool:
        q = self._tick.sample.q
        up = quaternion.act(q[3:7], self._session.robot.upright_axis)[2]
        low = float(q[2] - self._session.world.height(q[None, :2])[0]) < self._lowest
        return bool(self._session.controller.fallen or low or up < math.cos(math.radians(FALL_TILT_DEG)))

    def _observation(self) -> Array:
        state, controller = self._tick.state, self._session.controller
        robot, report, feet, clock = self._session.robot, controller.report, controller.feet, controller.feet.clock
        height = state.q[2] - feet.ground.plane_at(*state.q[:2].tolist())
        up = quaternion.act(quaternion.inverse(state.q[3:7]), np.array([0.0, 0.0, 1.0]))
        waits = np.array([clock.next_liftoff(foot, state.time) - state.time for foot in range(robot.nf)])
        phase = 2.0 * math.pi * np.where(np.isfinite(waits), waits, 0.0) / clock.gait.period_s
        outside = report.external_wrench / np.repeat([robot.weight, robot.weight * float(robot.q_reference[2])], 3)
        posture = state.q[robot.joint_q] - robot.q_reference[robot.joint_q]
        parts = (self._goal, [height], up, state.v[:6], posture, state.v[robot.joint_v])
        numbers = np.concatenate([*parts, feet.stance, np.sin(phase), np.cos(phase), outside, self._action])
        return np.clip(np.nan_to_num(numbers), -_LARGEST, _LARGEST)


_ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "lgmpc/Solo12Velocity-v0": {"config": "solo12_velocity", "overrides": ("pushes=[]",)},
    "lgmpc/Go2Velocity-v0": {"config": "go2_velocity", "overrides": ("pushes=[]",)},
}
_register: Callable[..., None] = gymnasium.register
for _name, _arguments in _ENVIRONMENTS.items():
    _register(_name, entry_point="lgmpc.gym:LocomotionEnv", kwargs=_arguments)
