"""Whole placements on real physics with sensor noise: the camera's contact portion against the mesh's."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from layflat.app.workers.run_items import demonstrations, run_items
from layflat.app.workers.work_item import DisturbanceCase, read_run
from layflat.policy.schedule import ScheduledDisturbance
from layflat.sim.config import SimConfig


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_camera_agrees_with_the_mesh_over_whole_placements(tmp_path):
    """Mean absolute error at most 0.02 in each, of the steps in which any of the cloth lies: air would dilute it."""
    items = []
    for robot in ("hanger", "pickers"):
        for cloth, seed, name in (("towel", 60, "thesis"), ("napkin", 61, "push"), ("towel", 62, "pull")):
            case = DisturbanceCase(name=name, schedule=(ScheduledDisturbance(disturbance=name),))
            (item,) = demonstrations(SimConfig(robot=robot, cloth=cloth), [seed])
            items.append(replace(item, cases=(case,)))
    with closing(run_items(items, tmp_path, workers=1)) as results:
        for result in results:
            assert not result.lost
            episode = read_run(tmp_path, result.item.run_ids[0])
            true = np.array([ground_truth.contact_portion_true for ground_truth in episode.ground_truths()])
            lying = true > 0
            errors = (episode.contact() - true)[lying]
            assert np.abs(errors).mean() <= 0.02, result.item
            assert abs(errors.mean()) <= 0.015, result.item
            assert lying.sum() > 40, result.item
