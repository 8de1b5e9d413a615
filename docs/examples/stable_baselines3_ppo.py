"""Train PPO of stable-baselines3 in the environment, and roll the policy out.

pip install layflat stable-baselines3
python stable_baselines3_ppo.py --steps 20000 --envs 2
"""

from __future__ import annotations

import argparse

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

ENVIRONMENT = "layflat:layflat/ClothPlace-v0"


def make_env() -> gymnasium.Env:
    """Make one environment; `Monitor` logs return, length and success of its episodes."""
    return Monitor(gymnasium.make(ENVIRONMENT, robot="hanger", cloth="towel"), info_keywords=("is_success",))


def main() -> None:
    """Train, save, evaluate."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--steps", type=int, default=20_000, help="steps in all environments together")
    options.add_argument("--envs", type=int, default=2, help="environments, each in a process of its own")
    options.add_argument("--rollout", type=int, default=512, help="steps of one environment between updates")
    options.add_argument("--out", default="ppo.zip", help="file of the policy")
    given = options.parse_args()

    makers = [make_env] * given.envs
    envs = SubprocVecEnv(makers) if given.envs > 1 else DummyVecEnv(makers)
    # MultiInputPolicy takes the dictionary of observations; with images=True it has a CNN for them.
    model = PPO("MultiInputPolicy", envs, n_steps=given.rollout, batch_size=64, seed=1, verbose=1)
    model.learn(given.steps)
    model.save(given.out)
    envs.close()

    env = make_env()
    mean, spread = evaluate_policy(PPO.load(given.out), env, n_eval_episodes=1)
    print(f"return {mean:.2f} +- {spread:.2f}; a policy that lays the towel flat earns 1")
    env.close()


if __name__ == "__main__":
    main()
