"""Saved episodes are there after SIGKILL, on a full disk, with a second writer."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import itertools
import os
import random
import resource
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from layflat.data import SessionRecorder, open_session
from layflat.data.errors import DataError
from layflat.data.session.parts import parts_folder
from layflat.data.types import Episode
from layflat.tests.data.session.children import run_child
from layflat.tests.factories import HANGER, PICKERS, differences, make_episode


@pytest.fixture
def numbered() -> Callable[[int], Episode]:
    """The same number always gives the same episode, here and in a child."""
    return lambda number: make_episode(seed=number, n_steps=4, nodes=10)


def _record(path: Path, report: int, first: int, runs: int, per_run: int, numbered: Callable[[int], Episode]) -> None:
    """Write episodes, and the name and number of each saved one to the pipe."""
    number = first
    for _ in range(runs):
        with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
            for _ in range(per_run):
                name = recorder.save(numbered(number)).name
                os.write(report, f"saved {name} {number}\n".encode())
                number += 1


def _reported(lines: list[list[str]]) -> dict[str, int]:
    """Return the reported names and numbers."""
    return {name: int(number) for _, name, number in lines}


@pytest.mark.parametrize("series", range(3))
def test_every_saved_episode_survives_sigkill(tmp_path, numbered, series):
    """Six kills in a row of one growing session; each run first finds what the last left."""
    path, rng = tmp_path / "s.h5", random.Random(series)
    saved: dict[str, int] = {}
    for kill in range(6):
        # Numbers far apart, because one episode may have become durable without its line having been written.
        work = functools.partial(_record, path, first=1000 * kill, runs=1000, per_run=7, numbered=numbered)
        status, lines, _ = run_child(work, kill_after_s=rng.uniform(0.0, 0.25))
        reported = _reported(lines)
        assert status == -signal.SIGKILL
        assert not set(saved) & set(reported), "a name was given twice"
        saved |= reported
        if saved:
            with open_session(path) as session:
                found = {name: session.episode(name) for name in saved}
            assert all(differences(found[name], numbered(number)) == [] for name, number in saved.items())
    assert len(saved) >= 6
    SessionRecorder(path, robot=HANGER, cloth="towel").close()
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"], "the next recorder tidies up"
    with open_session(path) as session:
        assert set(saved) <= set(session.names)


@pytest.mark.parametrize("call", ["os.replace", "os.unlink", "os.fsync", "os.rmdir", "fcntl.flock"])
def test_a_death_at_each_system_call_loses_nothing(tmp_path, call, numbered):
    """Dies before the n-th call of one kind, for every n: the moments that random kills would rarely hit."""
    module, name = {"os": os, "fcntl": fcntl}[call.split(".")[0]], call.split(".")[1]
    real = getattr(module, name)
    for countdown in itertools.count():
        path = tmp_path / f"{countdown}.h5"
        left = [countdown]

        def deadly(*args, left=left, **kwargs):
            if left[0] == 0:
                os._exit(9)
            left[0] -= 1
            return real(*args, **kwargs)

        def work(report, path=path, deadly=deadly):
            setattr(module, name, deadly)
            _record(path, report, first=0, runs=2, per_run=2, numbered=numbered)

        status, lines, _ = run_child(work)
        reported = _reported(lines)
        assert status in (0, 9)
        if reported:
            with open_session(path) as session:
                assert all(differences(session.episode(n), numbered(i)) == [] for n, i in reported.items())
                assert len({session.info(n).uid for n in session.names}) == len(session) <= len(reported) + 1
        if status == 0:
            break
    assert len(reported) == 4


def test_a_session_exists_from_the_first_saved_episode_on(tmp_path):
    path = tmp_path / "s.h5"
    made = [make_episode(seed=i) for i in range(9)]
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        assert not path.exists()
        for count, episode in enumerate(made, start=1):
            recorder.save(episode)
            with open_session(path) as session:  # Beside the writer.
                assert [differences(a, b) for a, b in zip(session, made, strict=False)] == [[]] * count


def test_a_session_without_an_episode_leaves_nothing(tmp_path):
    with SessionRecorder(tmp_path / "s.h5", robot=HANGER, cloth="towel"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_reader_keeps_its_view_while_a_recorder_writes(tmp_path):
    path = tmp_path / "s.h5"
    recorder = SessionRecorder(path, robot=HANGER, cloth="towel")
    made = [make_episode(seed=i) for i in range(20)]
    for episode in made[:3]:
        recorder.save(episode)
    with open_session(path) as session:
        for episode in made[3:]:
            recorder.save(episode)
        recorder.close()
        assert [differences(a, b) for a, b in zip(session, made[:3], strict=True)] == [[]] * 3


def test_a_part_whose_number_is_used_gets_another(tmp_path):
    path = tmp_path / "s.h5"
    old, new = make_episode(seed=1), make_episode(seed=2)
    for episode in (old, new):
        with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
            recorder.save(episode)
        path.rename(tmp_path / f"{episode.seed}.h5")
    parts_folder(path).mkdir()
    (tmp_path / "1.h5").rename(parts_folder(path) / "demo_0.h5")
    (tmp_path / "2.h5").rename(path)
    for _ in range(2):
        with open_session(path) as session:
            assert [differences(a, b) for a, b in zip(session, (new, old), strict=True)] == [[], []]
        SessionRecorder(path, robot=HANGER, cloth="towel").close()


def test_parts_of_another_session_are_refused(tmp_path):
    path = tmp_path / "s.h5"
    other = tmp_path / "other.h5"
    for file, robot in ((other, PICKERS), (path, HANGER)):
        with SessionRecorder(file, robot=robot, cloth="towel") as recorder:
            recorder.save(make_episode(robot))
    before = path.read_bytes()
    parts_folder(path).mkdir()
    other.rename(parts_folder(path) / "demo_4.h5")
    for use in (open_session, lambda p: SessionRecorder(p, robot=HANGER, cloth="towel")):
        with pytest.raises(
            DataError, match=r"demo_4\.h5 belongs to another session \(robot pickers.*move it elsewhere"
        ):
            use(path)
    assert path.read_bytes() == before


@contextlib.contextmanager
def _files_end_at(limit: int):
    """As a full disk does, the system refuses to write on (EFBIG); works without mounting anything."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_no_room_for_an_episode(tmp_path):
    path = tmp_path / "s.h5"
    episode = make_episode(n_steps=30, nodes=100)
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(episode)
        before = path.read_bytes()
        for limit in (0, 1, 4096, 50_000):
            with _files_end_at(limit), pytest.raises(DataError, match=r"s\.h5 cannot be written: File too large"):
                recorder.save(episode)
            assert path.read_bytes() == before
            assert [p.name for p in parts_folder(path).iterdir()] == ["lock"]
        assert recorder.save(episode).name == "demo_1"
    with open_session(path) as session:
        assert [differences(e, episode) for e in session] == [[], []]


def test_no_room_to_assemble(tmp_path):
    """Each part fits, the whole does not: all is saved and readable, closing raises, and with room all is assembled."""
    path = tmp_path / "s.h5"
    made = [make_episode(n_steps=30, nodes=100, seed=i) for i in range(4)]
    recorder = SessionRecorder(path, robot=HANGER, cloth="towel")
    size = recorder.save(made[0]).size_bytes
    with _files_end_at(int(size * 1.5)):
        for episode in made[1:]:
            recorder.save(episode)
        with pytest.raises(DataError, match=r"s\.h5 cannot be written: File too large .*; .* are safe$"):
            recorder.close()
    for _ in range(2):
        with open_session(path) as session:
            assert [differences(a, b) for a, b in zip(session, made, strict=True)] == [[]] * 4
        assert not list(tmp_path.rglob("*.part"))
        SessionRecorder(path, robot=HANGER, cloth="towel").close()
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


def test_a_second_writer_is_refused(tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        with pytest.raises(DataError, match=rf"being written by another program \(process {os.getpid()}\)"):
            SessionRecorder(path, robot=HANGER, cloth="towel")
        (tmp_path / "alias.h5").symlink_to(path)
        with pytest.raises(DataError, match="being written"):
            SessionRecorder(tmp_path / "alias.h5", robot=HANGER, cloth="towel")
        recorder.save(make_episode())
    SessionRecorder(path, robot=HANGER, cloth="towel").close()


def test_an_interrupt_while_saving_loses_nothing(tmp_path, monkeypatch):
    path, episode = tmp_path / "s.h5", make_episode()

    def interrupted(*_):
        raise KeyboardInterrupt

    def interrupted_run():
        with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
            recorder.save(episode)
            with monkeypatch.context() as patch:
                patch.setattr(os, "replace", interrupted)
                recorder.save(episode)

    with pytest.raises(KeyboardInterrupt):
        interrupted_run()
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]
    with open_session(path) as session:
        assert [differences(e, episode) for e in session] == [[]]
