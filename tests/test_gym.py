"""Environments of Gymnasium: its checker, repeatability, actions, and vectors over processes."""

from contextlib import closing
from functools import partial

import gymnasium
import numpy as np
import pinocchio as pin
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

import lgmpc
from lgmpc.errors import ConfigError, InputError
from lgmpc.gym import ACTIONS, LocomotionEnv

GOAL = {"goal": [0.4, 0.0, 0.2]}
short = partial(LocomotionEnv, overrides=["pushes=[]"], episode_s=0.6)


def rollout(env: LocomotionEnv, actions: np.ndarray, seed: int = 3) -> tuple[np.ndarray, list[float]]:
    observations, rewards = [env.reset(seed=seed, options=GOAL)[0]], []
    for action in actions:
        observation, reward, *_ = env.step(action)
        observations.append(observation)
        rewards.append(reward)
    return np.array(observations), rewards


def test_gymnasium_makes_it_and_its_checker_passes() -> None:
    for name in ("lgmpc/Solo12Velocity-v0", "lgmpc.gym:lgmpc/Solo12Velocity-v0"):
        env = gymnasium.make(name, action="torque", episode_s=0.1)
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    "kind", [each if each == "torque" else pytest.param(each, marks=pytest.mark.slow) for each in ACTIONS]
)
def test_actions_are_named_act_and_are_repeatable_bit_for_bit(kind: str) -> None:
    env = short(action=kind)
    assert env.action_space.shape == (len(env.action_names),)
    assert env.observation_space.shape == (len(env.observation_names),) == (len(set(env.observation_names)),)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (20, len(env.action_names)))
    first, other = rollout(env, actions), rollout(short(action=kind), actions)
    assert np.array_equal(first[0], other[0]) and first[1] == other[1]
    alone, _ = rollout(env, 0.0 * actions)
    assert not np.allclose(alone[-1, :-1], first[0][-1, :-1], atol=1e-4)


def test_an_action_of_zeros_is_the_controller_alone() -> None:
    env = short(action="footholds")
    observations, _ = rollout(env, np.zeros((30, 8)))
    other, _ = rollout(short(action="torque"), np.zeros((30, 12)))
    assert np.array_equal(other[:, :50], observations[:, :50])
    config = lgmpc.load_config(
        "solo12_velocity",
        ["pushes=[]", "duration_s=0.6", "log.rate_hz=1000"]
        + ["commands=[{at_s: 0, velocity_m_s: [0.4, 0, 0], yaw_rate_rad_s: 0.2, gait: trot}]"],
    )
    log = lgmpc.config.build.prepare(config).run(lambda progress: None).log
    names = env.observation_names
    joints = observations[1:, [i for i, name in enumerate(names) if name.startswith("dq.")]]
    ticks = 20 * np.arange(1, 30)
    assert np.array_equal(joints[:-1], log.joint_velocity[ticks])
    assert np.array_equal(observations[1:-1, names.index("v.linear.x")], log.v[ticks, 0])


def test_rewards_are_those_documented_and_falls_end_episodes() -> None:
    env = LocomotionEnv(action="torque", overrides=["pushes=[]"], episode_s=0.4)
    env.reset(seed=0, options={"goal": [0.0, 0.0, 0.0]})
    _, reward, terminated, truncated, info = env.step(np.full(12, 0.5))
    error, turning = info["velocity_error_m_s"], info["yaw_rate_error_rad_s"]
    assert reward == 0.75 * np.exp(-((error / 0.25) ** 2)) + 0.25 * np.exp(-((turning / 0.5) ** 2)) - 0.02 * 0.25
    assert not terminated and not truncated
    q, v = env._session.plant.sense().q, env._session.plant.sense().v  # the reward is of the tick before, 1 ms
    world = pin.Quaternion(q[3:7]).matrix() @ v[:3]
    assert abs(error - np.linalg.norm(world[:2])) < 0.02
    for _ in range(19):
        *_, truncated, _ = env.step(np.zeros(12))
    assert truncated
    pushed = ["pushes=[{body: base_link, time_s: 0.1, impulse_ns: [0, 40, 0]}]"]
    env = LocomotionEnv(action="torque", overrides=pushed, episode_s=2.0)
    env.reset(seed=0)
    assert any(env.step(np.zeros(12))[2] for _ in range(60))


def test_vectors_over_processes_are_the_environments_bit_for_bit() -> None:
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (10, 2, 3))
    with closing(AsyncVectorEnv([short, short])) as envs:
        read = [envs.reset(seed=[5, 6], options=GOAL)[0]]
        read += [envs.step(each)[0] for each in actions]
    for k, seed in enumerate((5, 6)):
        alone, _ = rollout(short(), actions[:, k], seed)
        assert np.array_equal(np.array(read)[:, k], alone)


def test_bad_arguments_are_named() -> None:
    with pytest.raises(InputError, match="action: got torques; .* Did you mean torque"):
        LocomotionEnv(action="torques")
    with pytest.raises(InputError, match="rate_hz: got 33"):
        LocomotionEnv(rate_hz=33.0)
    with pytest.raises(ConfigError, match="plant.frictio"):
        LocomotionEnv(overrides=["plant.frictio=0.3"])
    env = short()
    with pytest.raises(InputError, match="options"):
        env.reset(options={"goals": [0, 0, 0]})
    env.reset(seed=0)
    with pytest.raises(InputError, match="action: .* expected 3 finite numbers: vx, vy, yaw_rate"):
        env.step([np.nan, 0.0, 0.0])
