"""Train a linear residual on the commands of the MPC on a floor that is more slippery than the controller assumes.

Evolution strategies with antithetic pairs (Salimans et al. 2017), one of each pair in a process of its own. Prints
rewards and falls of the controller alone and with the residual on goals that the training has not seen:

    python scripts/train_residual.py --minutes 8 --set plant.friction=0.2
"""

from __future__ import annotations

import argparse
from contextlib import closing
from functools import partial
from time import perf_counter

import numpy as np
from gymnasium.vector import AsyncVectorEnv

from lgmpc.gym import LocomotionEnv
from lgmpc.typing import Array

SIGMA, RATE, SEEN, HELD_OUT = 0.15, 0.05, ("goal", "v.linear.x", "v.linear.y", "v.angular.z"), 24


def features(observations: Array, columns: list[int]) -> Array:
    """Return (m, k) what the policies see: one, the goal, and the velocity."""
    return np.column_stack([np.ones(len(observations)), observations[:, columns]])


def returns(envs: AsyncVectorEnv, policies: Array, seeds: list[int], columns: list[int]) -> tuple[Array, Array]:
    """Return the mean reward a step of each policy (m, n, k) until it falls, and whether it fell."""
    observations, _ = envs.reset(seed=seeds)
    total, fell, steps = np.zeros(len(seeds)), np.zeros(len(seeds), dtype=bool), 0
    while True:
        actions = np.einsum("mnk,mk->mn", policies, features(observations, columns))
        observations, rewards, terminated, truncated, _ = envs.step(np.clip(actions, -1.0, 1.0))
        total += np.where(fell, 0.0, rewards * ~terminated)
        fell |= terminated
        steps += 1
        if truncated.any() or fell.all():
            return total / envs.get_attr("_steps")[0], fell


def main() -> None:
    """Train, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    overrides = ["pushes=[]", *(given.overrides or ["plant.friction=0.2"])]
    make = partial(LocomotionEnv, action="command", overrides=overrides, rate_hz=10.0, episode_s=4.0)
    names = make().observation_names
    columns = [i for i, name in enumerate(names) if name.startswith(SEEN)]
    rng = np.random.default_rng(given.seed)
    policy, moment = np.zeros((2, 3, 1 + len(columns)))
    with closing(AsyncVectorEnv([make, make])) as envs:
        started, pairs, best = perf_counter(), 0, []
        while perf_counter() - started < 60.0 * given.minutes:
            noise, seed = rng.normal(size=policy.shape), int(rng.integers(2**31))
            pair = np.array([policy + SIGMA * noise, policy - SIGMA * noise])
            (plus, minus), _ = returns(envs, pair, [seed, seed], columns)
            moment = 0.8 * moment + 0.2 * (plus - minus) / (2.0 * SIGMA) * noise
            policy += RATE * moment / (np.linalg.norm(moment) + 1e-9)
            pairs += 1
            best.append(0.5 * (plus + minus))
            if pairs % 20 == 0:
                print(
                    f"{pairs:5d} pairs, {perf_counter() - started:4.0f} s, mean reward {np.mean(best[-20:]):.3f}",
                    flush=True,
                )
        both = np.array([np.zeros_like(policy), policy])
        found = [returns(envs, both, [10**6 + k] * 2, columns) for k in range(HELD_OUT)]
    (plain, residual), falls = np.mean([r for r, _ in found], axis=0), np.sum([f for _, f in found], axis=0)
    better = sum(bool(r[1] > r[0]) for r, _ in found)
    print(f"{pairs} pairs; on {HELD_OUT} goals that were not seen:")
    print(f"  controller alone  mean reward {plain:.3f}, {falls[0]} falls")
    print(f"  with residual     mean reward {residual:.3f}, {falls[1]} falls; better on {better}")


if __name__ == "__main__":
    main()
