"""RateLimiter on a clock of its own."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.app.workstation.session.rate_limiter import RateLimiter


def run_steps(
    works: list[float], *, speed: float = 1.0, pause_after: int | None = None
) -> tuple[list[float], RateLimiter]:
    """Return when each step started, on a machine that needs ``works`` for them."""
    now = 100.0
    limiter = RateLimiter(0.1, speed, clock=lambda: now)
    started = []
    for k, work in enumerate(works):
        now += limiter.remaining_s()
        limiter.start_step()
        started.append(now)
        now += work
        limiter.end_step()
        if k == pause_after:
            limiter.pause()
            now += 60.0
    return started, limiter


@pytest.mark.parametrize(
    ("works", "speed", "lengths", "late"),
    [
        ([0.03, 0.08, 0.01, 0.09, 0.05], 1.0, [0.1] * 4, 0.0),
        # Hurrying after a slow step would make the motion jump under the person's hands.
        ([0.02, 0.35, 0.02, 0.02, 0.02], 1.0, [0.1, 0.35, 0.1, 0.1], 1 / 4),
        ([0.25] * 6, 1.0, [0.25] * 5, 1.0),
        ([0.01] * 5, 2.0, [0.05] * 4, 0.0),
    ],
    ids=["keeps up", "one slow step", "slow machine", "double speed"],
)
def test_steps_come_when_they_are_due_and_a_late_one_is_not_made_up_for(works, speed, lengths, late):
    started, limiter = run_steps(works, speed=speed)
    np.testing.assert_allclose(np.diff(started), lengths)
    assert limiter.real_time_factor == pytest.approx(0.1 / np.mean(lengths))
    assert limiter.describe() == (
        f"step {1000 * np.mean(lengths):.0f} ms mean, {1000 * max(lengths):.0f} ms worst, {100 * late:.0f} % late,"
        f" {1000 * np.mean(works):.0f} ms of it simulation"
    )


def test_a_pause_does_not_count_as_a_late_step():
    _, limiter = run_steps([0.0] * 4, pause_after=2)
    assert "100 ms worst" in limiter.describe()
