"""Roll out a policy of LeRobot in Layflat's environment.

    python lerobot_rollout.py CHECKPOINT                      # LeRobot 0.4.4 and Layflat in one Python 3.11
    python lerobot_rollout.py --server http://127.0.0.1:8765  # LeRobot of another Python, by lerobot_server.py

The environment takes actions as the export has them, in shares of the action limit.
"""

from __future__ import annotations

import argparse
import json
import urllib.request
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from lerobot_server import LeRobotPolicy, encoded  # the file beside this one

STEPS = 120
"""Half as long again as a demonstration."""


class RemotePolicy:
    """A policy behind lerobot_server.py."""

    def __init__(self, url: str) -> None:
        self._url = url.rstrip("/")
        self.inputs = self._ask("/")["inputs"]

    def reset(self) -> None:
        """Begin an episode."""
        self._ask("/reset", {})

    def act(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return the action for one observation."""
        answer = self._ask("/act", {key: encoded(observation[key]) for key in self.inputs})
        return np.asarray(answer["action"], np.float32)

    def _ask(self, path: str, content: dict[str, Any] | None = None) -> dict[str, Any]:
        body = None if content is None else json.dumps(content).encode()
        with urllib.request.urlopen(urllib.request.Request(self._url + path, body), timeout=60) as answer:
            return json.load(answer)


def as_lerobot(seen: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return an observation of the environment under the keys of the export."""
    state = [seen["corner_positions"].ravel(), seen["holder_position"]]
    cloth = [seen["word"], seen["word_strength"], seen["contact_portion"]]
    found = {
        "observation.state": np.concatenate(state).astype(np.float32),
        "observation.environment_state": np.concatenate(cloth).astype(np.float32),
    }
    return found | ({"observation.images.camera": seen["rgb"]} if "rgb" in seen else {})


def rollout(env: gymnasium.Env, policy: LeRobotPolicy | RemotePolicy, seed: int, steps: int) -> tuple[float, bool]:
    """Return the sum of rewards, which is the gain of contact, and whether the cloth lies flat at the end."""
    seen, info = env.reset(seed=seed)
    policy.reset()
    total = 0.0
    for _ in range(steps):
        action = policy.act({key: values for key, values in as_lerobot(seen).items() if key in policy.inputs})
        seen, reward, terminated, truncated, info = env.step(action)
        total += float(reward)
        if terminated or truncated:
            break
    return total, bool(info["is_success"])


def main() -> None:
    """Roll out and print each episode's return."""
    parser = argparse.ArgumentParser(description="Roll out a policy of LeRobot in Layflat's environment.")
    parser.add_argument("checkpoint", type=Path, nargs="?", help="folder .../checkpoints/last/pretrained_model")
    parser.add_argument("--server", help="address that lerobot_server.py printed")
    parser.add_argument("--robot", default="hanger")
    parser.add_argument("--cloth", default="towel")
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1000, help="of the first episode; not one of the demonstrations'")
    parser.add_argument("--steps", type=int, default=STEPS)
    options = parser.parse_args()
    if (options.checkpoint is None) == (options.server is None):
        parser.error("give a checkpoint or --server")
    policy = RemotePolicy(options.server) if options.server else LeRobotPolicy(options.checkpoint)
    images = "observation.images.camera" in policy.inputs
    env = gymnasium.make("layflat:layflat/ClothPlace-v0", robot=options.robot, cloth=options.cloth, images=images)
    returns, flat = [], 0
    for seed in range(options.seed, options.seed + options.episodes):
        gain, success = rollout(env, policy, seed, options.steps)
        returns.append(gain)
        flat += success
        print(f"seed {seed}: return {gain:.3f}, {'flat' if success else 'not flat'}", flush=True)
    env.close()
    print(f"mean return {np.mean(returns):.3f}, lowest {min(returns):.3f}, {flat} of {len(returns)} flat")


if __name__ == "__main__":
    main()
