"""Behaviour cloning with PyTorch on a session, and its policy.

    python torch_bc.py demos.h5 net.pt
    TORCH_BC=net.pt layflat evaluate torch_bc:NetPolicy --robot hanger --episodes 10 --out runs/net

Layflat makes one NetPolicy in each process.
"""

import os
import sys

import numpy as np
import torch

import layflat

INPUTS = ["corner_positions", "holder_position", "word", "word_strength", "contact_portion"]


def network(inputs: int, outputs: int) -> torch.nn.Module:
    """Return an untrained net; its first layer learns the mean and spread of the inputs."""
    scaled = torch.nn.BatchNorm1d(inputs, momentum=0.01, affine=False)
    return torch.nn.Sequential(scaled, torch.nn.Linear(inputs, 64), torch.nn.Tanh(), torch.nn.Linear(64, outputs))


def train(session: str, out: str, steps: str = "2000") -> None:
    """Fit the net, which answers in millimetres, to the successful demonstrations."""
    with layflat.open_session(session) as opened:
        arrays = opened.arrays([*(f"obs/{key}" for key in INPUTS), "action_m"], opened.select(outcome="success"))
    y = torch.tensor(1000 * np.asarray(arrays["action_m"]), dtype=torch.float32)
    rows = [np.asarray(arrays[f"obs/{key}"], np.float32).reshape(len(y), -1) for key in INPUTS]
    x, net = torch.from_numpy(np.concatenate(rows, 1)), network(sum(row.shape[1] for row in rows), y.shape[1])
    optimizer = torch.optim.Adam(net.parameters(), lr=2e-3)
    for _ in range(int(steps)):
        loss = ((net(x + 0.001 * torch.randn_like(x)) - y) ** 2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    torch.save(net.state_dict(), out)
    print(f"{len(x)} steps; the error of an action is {loss.item() ** 0.5:.2f} mm: {out}")


class NetPolicy:
    """The net as a policy, which stops where it hardly moves."""

    def __init__(self, spec: layflat.EnvironmentSpec) -> None:
        torch.set_num_threads(1)
        saved = torch.load(os.environ["TORCH_BC"], weights_only=True)
        self._net = network(len(saved["0.running_mean"]), spec.robot.size).eval()
        self._net.load_state_dict(saved)

    def reset(self, seed: int) -> None:
        """Start an episode."""
        self._still = 0

    def act(self, seen: layflat.Observation) -> layflat.Decision:
        """Decide one step, in metres."""
        x = torch.tensor(np.concatenate([np.ravel(getattr(seen, key)) for key in INPUTS])[None], dtype=torch.float32)
        action = 0.001 * self._net(x)[0].detach().double().numpy()
        self._still = self._still + 1 if np.abs(action).max() < 0.002 else 0
        return layflat.Decision(action=action, stop="threshold" if self._still >= 8 else None)


if __name__ == "__main__":
    train(*sys.argv[1:])
