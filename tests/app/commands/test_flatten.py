"""`layflat flatten` on real physics: WORD flattens what stretching and chance do not; pictures of the first seed."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from layflat.app.commands.flatten import STRIP_WIDTH, FlattenConfig, flatten
from layflat.app.media.video import count_frames
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS

pytestmark = pytest.mark.slow


def rows(folder: Path, **settings) -> list[dict]:
    flatten(FlattenConfig(json=folder / "rows.json", **settings), workers=2, force=True)
    return json.loads((folder / "rows.json").read_text())["episodes"]


def test_word_flattens_what_stretching_and_chance_do_not(tmp_path):
    """Seeds that nothing was tuned on."""
    found = {name: rows(tmp_path, controller=name, episodes=2, seed=300) for name in CONTROLLERS}
    final, true = (
        {name: np.mean([row[column] for row in found[name]]) for name in CONTROLLERS}
        for column in ("contact_final", "contact_final_true")
    )
    assert true["word"] >= 0.98
    assert final["word"] >= 0.98
    assert max(final["stretch-right"], true["stretch-right"]) < 0.95
    assert max(final["random"], true["random"]) < 0.85


def test_video_and_strip_show_the_first_seed(tmp_path):
    video, strip = tmp_path / "run.webm", tmp_path / "run.png"
    (row,) = rows(tmp_path, seed=4, video=video, strip=strip)
    assert count_frames(video) == row["steps"] + 1
    assert cv2.imread(str(strip)).shape[1] > 5 * STRIP_WIDTH
    assert {path.name for path in tmp_path.iterdir()} == {"run.webm", "run.png", "rows.json"}
