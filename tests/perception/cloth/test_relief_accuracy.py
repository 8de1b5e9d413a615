"""Numbers of docs/explanation/word.md on certainty: `pytest -m slow -s -k relief_accuracy` prints them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from layflat.tests.perception.factories import axis_error
from layflat.tests.perception.reliefs import CAMERAS, NOISES, random_relief, rectangle, shoot, true_tensor, with_noise

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
FIRST_SEED = 200_000


def sheet(seed: int, concentration: float, rms_slope: float):
    """Draw a cloth; return its wrinkles as judged, and its own tensor's angle, coherence and slope."""
    rng = np.random.default_rng(seed)
    height = random_relief(rng, concentration, rms_slope) if rms_slope else lambda x, y: 0.004 + 0 * x + 0 * y
    covers = rectangle(*rng.uniform(0.25, 0.42, 2), yaw=rng.uniform(0, math.pi))
    shot = with_noise(shoot(height, covers, CAMERAS[seed % 4]), NOISES[seed // 4 % 6], seed)
    return shot.relief().wrinkles(), true_tensor(height, covers) if rms_slope else (0.0, 0.0, 0.0)


def test_no_direction_on_flat_cloth():
    found = {}
    for seed in range(FIRST_SEED, FIRST_SEED + 600):
        found.setdefault(NOISES[seed // 4 % 6], []).append(sheet(seed, 0, 0)[0])
    for noise, flat in found.items():
        strengths = [one.strength for one in flat]
        print(
            f"{noise}: n {len(flat)}, strength 95 % {np.percentile(strengths, 95):.3f}, largest {max(strengths):.3f}, "
            f"noise {np.median([one.noise for one in flat]):.3f}, directions {sum(one.has_direction for one in flat)}"
        )
    assert sum(one.has_direction for flat in found.values() for one in flat) <= 6


def test_direction_where_the_relief_has_one():
    rng, rows = np.random.default_rng(FIRST_SEED), []
    for seed in range(FIRST_SEED + 10_000, FIRST_SEED + 10_288):
        found, (angle, coherence, slope) = sheet(seed, rng.uniform(0, 3), rng.uniform(0.06, 0.35))
        error = axis_error(found.axis, math.radians(angle)) if found.has_direction else math.nan
        rows.append((coherence, slope, found.strength, found.coherence, error))
    coherence, slope, strength, own, error = np.array(rows).T
    for least in (0.35, 0.5):
        one = coherence > least
        known = error[one & ~np.isnan(error)]
        print(
            f"coherence > {least}: n {one.sum()}, direction in {len(known)}, median {np.median(known):.1f}, "
            f"90 % {np.percentile(known, 90):.1f}, largest {known.max():.1f}; of slopes above 0.15 "
            f"{np.mean(~np.isnan(error[one & (slope > 0.15)])):.2f} have one"
        )
        assert len(known) >= 100
        assert np.median(known) < 5.0
        assert np.percentile(known, 90) < 8.0
    print(f"strength / slope {np.median(strength / slope):.2f}, correlation {np.corrcoef(strength, slope)[0, 1]:.2f}")
    print(f"coherence, correlation {np.corrcoef(own[strength > 0.1], coherence[strength > 0.1])[0, 1]:.2f}")


def test_crumpled_cloth_is_stronger_than_flat_cloth():
    crumpled = [sheet(FIRST_SEED + 20_000 + k, 0.0, 0.25)[0] for k in range(96)]
    strengths = [one.strength for one in crumpled]
    print(f"crumpled, slope 0.25: n {len(crumpled)}, strength {min(strengths):.3f} to {max(strengths):.3f}, "
          f"directions {sum(one.has_direction for one in crumpled)}")  # fmt: skip
    assert np.mean([one.is_flat for one in crumpled]) < 0.02
