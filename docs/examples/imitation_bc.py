"""Behavioural cloning with `imitation`, from a CSV export.

imitation 1.0 wants gymnasium 0.29 and Layflat wants 1.0, so they share no environment: Layflat writes the file, and
this script runs where imitation is installed.

    layflat data export demos.h5 --out tables --format csv
    python imitation_bc.py tables bc.pt
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from gymnasium import spaces
from imitation.algorithms import bc
from imitation.data.types import Transitions

OBSERVATION = [
    *(f"corner{corner}_{axis}_m" for corner in (1, 2) for axis in "xyz"),
    *("holder_x_m", "holder_y_m", "holder_z_m", "word_x", "word_y", "word_strength", "contact_portion"),
]
ACTION_LIMIT_M = 0.02


def main() -> None:
    """Train and save."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("tables", type=Path, help="folder of the export")
    options.add_argument("out", type=Path, help="file of the policy")
    options.add_argument("--epochs", type=int, default=20)
    given = options.parse_args()

    steps = pd.read_csv(given.tables / "steps.csv", float_precision="round_trip")
    before, after = steps[:-1], steps[1:]
    same = (before.episode.to_numpy() == after.episode.to_numpy()) & before.phase.notna().to_numpy()
    before, after = before[same], after[same]
    actions = [name for name in steps if name.startswith("d") and name.endswith("_m") and not name.startswith("drag")]
    transitions = Transitions(
        obs=before[OBSERVATION].to_numpy(np.float32),
        acts=(before[actions].to_numpy() / ACTION_LIMIT_M).astype(np.float32),
        infos=np.array([{}] * len(before)),
        next_obs=after[OBSERVATION].to_numpy(np.float32),
        dones=np.append(before.episode.to_numpy()[1:] != before.episode.to_numpy()[:-1], True),
    )
    trainer = bc.BC(
        observation_space=spaces.Box(-10.0, 10.0, (len(OBSERVATION),), np.float32),
        action_space=spaces.Box(-1.0, 1.0, (len(actions),), np.float32),
        demonstrations=transitions,
        rng=np.random.default_rng(1),
    )
    trainer.train(n_epochs=given.epochs)
    error = np.abs(trainer.policy.predict(transitions.obs, deterministic=True)[0] - transitions.acts).mean()
    trainer.policy.save(given.out)
    print(f"{len(transitions)} steps; the mean error of an action is {error:.3f} of the limit")


if __name__ == "__main__":
    main()
