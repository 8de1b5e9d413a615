"""The running episode's journal: what was handed over comes back, however it ends."""

from __future__ import annotations

import os
import random
import resource
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import pytest

from layflat.data import SessionRecorder, open_session, repair, validate
from layflat.data.errors import DataError
from layflat.data.session.journal import MAGIC, SYNC_S, JournalHandle
from layflat.data.session.journal_reader import read_journal
from layflat.data.session.parts import journals, parts_folder
from layflat.data.types import ACTION_LIMIT_M, DisturbanceRecord, DragTarget, Step
from layflat.tests.factories import HANGER, PICKERS, differences, initial_of, make_episode, prefix_of, write_session


@pytest.fixture
def handle(tmp_path) -> JournalHandle:
    path = tmp_path / "running-a.journal"
    return JournalHandle(path=path, uid="a", save_images=True, name="demo_0", session=tmp_path / "s.h5")


PUSH = DisturbanceRecord(name="push", first_step=1, last_step=2, plan={"at": [1, 2]})


@pytest.fixture
def written(handle):
    """A finished episode and the bytes of its journal, without the frame of its end and with it."""
    episode = make_episode(
        n_steps=4, nodes=5, images=True, with_std=True, initial_joints=[0.1, -0.2], disturbance="push"
    )
    first, *others = episode.steps
    pulled = {"drag": DragTarget(node=3, target_m=[0.1, 0, 0.2]), "force_n": [0, -0.1, 1], "phase": "disturb"}
    changes = [pulled, {"phase": "disturb", "intervention": True}, {"hand_m": [0.1, 0.2, 0.3]}]
    steps = [first, *(replace(step, **change) for step, change in zip(others, changes, strict=True))]
    episode = replace(episode, steps=steps, disturbances=[PUSH])
    journal = handle.open(replace(initial_of(episode), disturbances=()))
    for step_index, step in enumerate(episode.steps):
        if step_index == PUSH.first_step:
            journal.on_disturbance([replace(PUSH, last_step=None)])
        journal.step(step)
        if step_index == PUSH.last_step:
            journal.on_disturbance([PUSH])
    deadline = time.monotonic() + 10
    size = -1
    while size != handle.path.stat().st_size and time.monotonic() < deadline:
        size = handle.path.stat().st_size
        time.sleep(0.05)
    running = handle.path.read_bytes()
    journal.finish(episode)
    return episode, running, handle.path.read_bytes()


def _left(found, episode):
    """Return the part of the episode that its first steps hold; by hand, as in prefix_of."""
    n_steps = len(found.steps)
    disturbances = [] if n_steps < 2 else [replace(PUSH, last_step=None if n_steps == 2 else 2)]
    return prefix_of(episode, n_steps, wall_s=found.wall_s, disturbances=disturbances)


def _read(path: Path, content: bytes):
    path.write_bytes(content)
    return read_journal(path)


def test_a_finished_journal_holds_the_whole_episode(written, handle):
    episode, _, whole = written
    found = _read(handle.path, whole)
    assert (found.uid, found.complete) == ("a", True)
    assert differences(found.episode, episode) == []


def test_a_journal_cut_anywhere_holds_the_steps_before(written, handle):
    episode, running, _ = written
    lengths = []
    for end in [*range(0, len(running), 13), len(running)]:
        found = _read(handle.path, running[:end])
        n_steps = 0 if found is None else len(found.episode.steps)
        lengths.append(n_steps)
        if found is not None:
            assert not found.complete
            assert differences(found.episode, _left(found.episode, episode)) == []
    assert lengths == sorted(lengths)
    # The observation that the last step began with stands for the end.
    assert set(lengths) == set(range(len(episode.steps)))


def test_a_wrong_bit_ends_the_journal_and_is_never_read_as_something_else(written, handle):
    episode, running, _ = written
    rng = random.Random(0)
    for _ in range(150):
        damaged = bytearray(running)
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        found = _read(handle.path, bytes(damaged))
        if found is not None:
            assert differences(found.episode, _left(found.episode, episode)) == []


def test_a_journal_of_an_unreleased_version_is_refused(handle):
    handle.path.write_bytes(b"LAYFLAT journal 1\n" + bytes(100))
    with pytest.raises(DataError, match="unreleased version of layflat"):
        read_journal(handle.path)


@pytest.mark.parametrize("content", [b"", b"x", MAGIC, bytes(4096)])
def test_other_bytes_hold_no_episode(handle, content):
    assert _read(handle.path, content) is None


def test_a_step_that_does_not_fit_is_refused_and_the_rest_stays(handle):
    episode = make_episode(n_steps=3, nodes=5)
    journal = handle.open(initial_of(episode))
    journal.step(episode.steps[0])
    first = episode.steps[0]
    for step, message in (
        (make_episode(nodes=6).steps[0], "started with"),
        (make_episode(nodes=5, images=True).steps[0], "started with"),
        (replace(first, action=[0.0, ACTION_LIMIT_M * 1.01]), "within"),
        (make_episode(PICKERS, nodes=5).steps[0], "2 numbers"),
    ):
        with pytest.raises(DataError, match=message):
            journal.step(step)
    journal.step(episode.steps[1])
    journal.close()
    assert len(read_journal(handle.path).episode.steps) == 1
    with pytest.raises(DataError, match="File exists"):
        handle.open(initial_of(episode))


def test_no_step_waits_longer_than_a_second_for_the_disk(handle, monkeypatch):
    """What a power cut would take: every step must be covered by a flush that ends within a second of it."""
    episode = make_episode(n_steps=1, nodes=50)
    real, flushed = os.fsync, []

    def watched(descriptor):
        size = os.fstat(descriptor).st_size
        real(descriptor)
        flushed.append((time.monotonic(), size))

    monkeypatch.setattr(os, "fsync", watched)
    journal = handle.open(initial_of(episode))
    header = handle.path.stat().st_size
    handed = []
    for _ in range(120):
        journal.step(episode.steps[0])
        handed.append(time.monotonic())
        time.sleep(0.01)
    time.sleep(SYNC_S + 0.4)  # Without a further step, too, the last ones are flushed.
    on_disk = [(when, size) for when, size in flushed if size > header]
    per_step = (handle.path.stat().st_size - header) / len(handed)
    for number, when in enumerate(handed, start=1):
        assert min(t for t, size in on_disk if size >= header + number * per_step) - when < 1.0
    assert len(on_disk) < 20, "a flush for every step would wear the disk"
    journal.close()


def _until_refused(running, step: Step, most: int = 400) -> str:
    for _ in range(most):
        try:
            running.step(step)
        except DataError as error:
            return str(error)
        time.sleep(0.002)
    raise AssertionError("nothing was refused")


def test_a_full_disk_is_reported_at_the_next_step_and_costs_no_earlier_step(tmp_path):
    path, episode = tmp_path / "s.h5", make_episode(n_steps=60, nodes=50, images=True)
    with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
        recorder.save(episode)
        running = recorder.start(initial_of(episode))
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, hard))
        try:
            for step in episode.steps[:5]:
                running.step(step)
            sentence = _until_refused(running, episode.steps[5])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert "cannot be written: File too large" in sentence
        assert "\n" not in sentence
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]
    with open_session(path) as session:
        whole, partial = session
        assert differences(whole, episode) == []
        assert len(partial.steps) >= 5
        assert differences(partial.steps[:5], prefix_of(episode, 5).steps) == []


def test_an_error_of_the_disk_is_reported(tmp_path, monkeypatch):
    path, episode = tmp_path / "s.h5", make_episode(n_steps=4)
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(episode)
        running = recorder.start(initial_of(episode))
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", _broken)
            running.step(episode.steps[0])
            time.sleep(SYNC_S + 0.2)
            with pytest.raises(DataError, match="Input/output error"):
                running.step(episode.steps[1])
            with pytest.raises(DataError, match="Input/output error"):
                recorder.save(episode)
    with open_session(path) as session:
        assert differences(session["demo_0"], episode) == []


def _broken(descriptor):
    raise OSError(5, "Input/output error")


def test_running_episodes_are_saved_discarded_or_left(tmp_path):
    path = tmp_path / "s.h5"
    made = [make_episode(n_steps=4, seed=seed, outcome="failure") for seed in range(3)]
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        runs = [recorder.start(initial_of(episode)) for episode in made]
        for number, (running, episode) in enumerate(zip(runs, made, strict=True)):
            for step_index, step in enumerate(episode.steps):
                running.on_step(step, step_index + 1)
            if number == 0:
                assert running.save(episode).name == "demo_0"
            elif number == 1:
                running.discard()
        assert len(journals(parts_folder(path))) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]
    with open_session(path) as session:
        assert len(session) == 2
        assert differences(session[0], made[0]) == []
        left = prefix_of(made[2], 3, stopped_by="interrupted", wall_s=session[1].wall_s)
        assert differences(session[1], left) == []


def test_a_killed_save_is_completed_once_and_not_twice(tmp_path):
    """The journal holds the whole episode before it is saved, so that a kill at either moment loses nothing."""
    path, episode = tmp_path / "s.h5", make_episode(n_steps=4)
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        handle = recorder.new_journal()
        journal = handle.open(initial_of(episode))
        for step in episode.steps:
            journal.step(step)
        journal.finish(episode)
        content = handle.path.read_bytes()
        recorder.save(episode, journal=handle)
    parts_folder(path).mkdir()
    handle.path.write_bytes(content)
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        assert recorder.recovered == ()
    path.unlink()
    parts_folder(path).mkdir()
    handle.path.write_bytes(content)
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        assert [(saved.name, saved.outcome) for saved in recorder.recovered] == [("demo_0", "success")]
    with open_session(path) as session:
        assert [differences(e, episode) for e in session] == [[]]


def test_validate_reports_an_interrupted_recording(tmp_path, written, handle):
    path = write_session(tmp_path / "s.h5", [make_episode()])
    assert validate(path) == ()
    parts_folder(path).mkdir()
    journal = parts_folder(path) / handle.path.name
    journal.write_bytes(written[1])
    assert [violation.path for violation in validate(path)] == [journal.name]
    assert len(repair(path).recovered) == 1
    assert validate(path) == ()


def test_the_wall_clock_may_jump(tmp_path, monkeypatch):
    path, made = tmp_path / "s.h5", [make_episode(seed=i) for i in range(4)]
    clock = iter([4e9, 0.0, 1e9, 2.5e9] * 1000)
    monkeypatch.setattr(time, "time", lambda: next(clock))
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        for number, episode in enumerate(made):
            running = recorder.start(initial_of(episode))
            for step in episode.steps:
                running.step(step)
            running.save(episode)
            for part in parts_folder(path).glob("*.h5"):
                os.utime(part, (4e9 - number * 1e9, 4e9 - number * 1e9))
    with open_session(path) as session:
        assert [differences(a, b) for a, b in zip(session, made, strict=True)] == [[]] * 4


@pytest.fixture
def small_disk(tmp_path):
    """A file system of one megabyte."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("only root may mount a small disk")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def test_a_disk_that_fills_up_at_any_moment(small_disk):
    """Room for less and less, so that begin, steps, keep and assembly fail in turn; each time all is there that was."""
    episode = make_episode(n_steps=12, nodes=60, images=True)
    refused, partial, sentences = 0, 0, []
    for free in (4_000, 10_000, 16_000, 22_000, 28_000, 60_000, 110_000, 220_000):
        path = small_disk / f"{free}.h5"
        saved = _fill_and_record(path, small_disk / "ballast", free, episode, sentences)
        refused += saved < 4
        if path.exists() or parts_folder(path).exists():
            report = repair(path)
            assert report.lost == ()
            assert validate(path) == ()
            with open_session(path) as session:
                whole = [e for e in session if e.outcome == "success"]
                # One that could not be saved may have had room in its journal for all of it.
                assert saved <= len(whole) <= saved + 1
                assert all(differences(e, episode) == [] for e in whole)
                for e in [e for e in session if e.outcome == "partial"]:
                    same = prefix_of(episode, len(e.steps), stopped_by=e.stopped_by, wall_s=e.wall_s)
                    assert differences(e, same) == []
                    partial += 1
            path.unlink()
        assert list(small_disk.iterdir()) == []
    assert len(sentences) >= refused >= 5
    assert all("No space left on device" in sentence and "\n" not in sentence for sentence in sentences)
    assert partial >= 2


def _fill_and_record(path, ballast, free, episode, sentences) -> int:
    """How many episodes were saved before the disk was full; leaves the disk with room again."""
    room = os.statvfs(path.parent)
    ballast.write_bytes(bytes(max(0, room.f_bavail * room.f_frsize - free)))
    saved = 0
    try:
        with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
            for _ in range(4):
                running = recorder.start(initial_of(episode))
                for step in episode.steps:
                    running.step(step)
                running.save(episode)
                saved += 1
    except DataError as error:
        sentences.append(str(error))
    finally:
        ballast.unlink()
    return saved
