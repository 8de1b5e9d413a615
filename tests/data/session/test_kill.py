"""A recording process is killed at random moments: no saved episode is lost, and repair recovers the running one.

The child runs episodes step by step with a journal and keeps them, and tells through a pipe what it has handed over
and what was saved. Each kill is of the same growing session, so that what one leaves is there for the next.
"""

from __future__ import annotations

import itertools
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from layflat.data import SessionRecorder, open_session, repair, validate
from layflat.data.types import Episode
from layflat.tests.data.session.children import run_child
from layflat.tests.factories import HANGER, differences, initial_of, make_episode, prefix_of

STEPS = 12


@pytest.fixture
def numbered() -> Callable[[int], Episode]:
    """The same number always gives the same episode, here and in a child."""
    return lambda number: make_episode(seed=number, n_steps=STEPS, nodes=10, images=True)


def _record(path: Path, report: int, first: int, step_s: float, numbered) -> None:
    with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
        for number in itertools.count(first):
            episode = numbered(number)
            running = recorder.start(initial_of(episode))
            for step_index, step in enumerate(episode.steps):
                running.step(step)
                os.write(report, f"step {number} {step_index} {time.monotonic()}\n".encode())
                time.sleep(step_s)
            saved = running.save(episode)
            os.write(report, f"saved {number} {saved.name} {time.monotonic()}\n".encode())


def _check_whole(path: Path, saved: dict[int, str], numbered) -> dict[int, int]:
    """Check that saved episodes are equal and others are true beginnings; return the steps by number."""
    lengths = {}
    with open_session(path) as session:
        by_seed = {info.seed: name for name, info in session.infos().items()}
        assert saved.items() <= by_seed.items()
        for seed, name in by_seed.items():
            found, episode = session.episode(name), numbered(seed)
            lengths[seed] = len(found.steps)
            if seed not in saved and found.outcome == "partial":
                episode = prefix_of(episode, len(found.steps), wall_s=found.wall_s)
            assert differences(found, episode) == []
    return lengths


def _kill_again_and_again(path, kills, longest_s, step_s, numbered) -> list[float]:
    """Seconds of the running episode that each kill cost."""
    rng, saved, costs = random.Random(kills), {}, []
    for kill in range(kills):
        first = 1000 * kill

        def work(report, first=first):
            _record(path, report, first, step_s, numbered)

        status, lines, killed_at = run_child(work, kill_after_s=rng.uniform(0.0, longest_s))
        assert status == -signal.SIGKILL
        saved |= {int(line[1]): line[2] for line in lines if line[0] == "saved"}
        if path.exists():
            _check_whole(path, saved, numbered)
        if kill % 2 and path.exists():
            assert repair(path).lost == ()
        else:
            SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True).close()
        assert [p.name for p in path.parent.iterdir() if p != path] == []
        lengths = _check_whole(path, saved, numbered) if path.exists() else {}
        handed = [(int(n), int(step_index), float(when)) for kind, n, step_index, when in lines if kind == "step"]
        # The step whose observation is still missing is not finished.
        missing = [when for n, step_index, when in handed if n not in saved and step_index > lengths.get(n, 0)]
        costs.append(killed_at - min(missing, default=killed_at))
        if kill % 10 == 0:
            assert validate(path) == ()
            path.unlink()
            saved = {}
    return costs


def test_twenty_kills(tmp_path, numbered):
    path = tmp_path / "s.h5"
    costs = _kill_again_and_again(path, 20, 0.12, 0.002, numbered)
    assert max(costs) < 1.0


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_two_hundred_kills(tmp_path, numbered):
    """With steps as long as real ones (scaled by half), so that a second of the running episode could be lost."""
    path = tmp_path / "s.h5"
    costs = _kill_again_and_again(path, 200, 1.5, 0.05, numbered)
    print(f"seconds lost: mean {sum(costs) / len(costs):.4f}, most {max(costs):.4f} of {len(costs)} kills")
    assert max(costs) < 1.0
