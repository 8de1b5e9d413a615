"""Items of one case each: results in order, Ctrl-C, closing, and recording through the loss of workers."""

from __future__ import annotations

import os
import signal
import time
from contextlib import closing

import psutil
import pytest

from layflat.app.support.progress import Progress
from layflat.app.workers.run_items import collect_items, demonstrations, run_items
from layflat.app.workers.work_item import run_file
from layflat.data import SessionRecorder, open_session, validate
from layflat.data.session.journal import JournalHandle
from layflat.data.session.parts import parts_folder
from layflat.data.types import Episode
from layflat.sim.config import SimConfig
from layflat.tests.app.fake_episodes import PLACING, FakeEpisodes, key_of

CONFIG = SimConfig(robot="pickers", cloth="napkin")


def items(count: int):
    return demonstrations(CONFIG, range(count))


class SlowFirst(FakeEpisodes):
    """The first items take longest, so that they end in the opposite order."""

    def inject(self, item, where) -> None:
        time.sleep(0.15 * (3 - item.seed))


def collected(recorder: SessionRecorder | None, tasks, folder, make, workers: int = 1, on_saved=lambda saved: None):
    with Progress({"items": 1.0}) as progress:
        progress.phase("items", items=len(tasks))
        return collect_items(tasks, folder, progress, workers=workers, recorder=recorder, on_saved=on_saved, make=make)


def test_results_come_in_the_order_of_the_items(tmp_path):
    with closing(run_items(items(4), tmp_path, workers=4, make=SlowFirst())) as results:
        assert [result.item.seed for result in results] == [0, 1, 2, 3]


def test_an_item_is_taken_when_a_worker_is_free(tmp_path):
    taken: list[int] = []

    def tasks():
        for item in items(5):
            taken.append(item.seed)
            yield item

    with closing(run_items(tasks(), tmp_path, workers=2, make=FakeEpisodes(step_s=0.05))) as results:
        next(results)
        assert len(taken) < 5


def test_closing_ends_the_workers(tmp_path):
    def children() -> list[psutil.Process]:
        return [child for child in psutil.Process().children() if child.status() != psutil.STATUS_ZOMBIE]

    before = len(children())
    results = run_items(items(3), tmp_path, workers=3, make=FakeEpisodes({(key_of(items(2)[1]), PLACING): ("hang",)}))
    next(results)
    assert len(children()) > before
    results.close()
    assert len(children()) == before


def test_ctrl_c_is_raised_when_all_that_is_finished_has_been_dealt_with(tmp_path):
    """Item 1 is finished before item 0, in which Ctrl-C comes; item 0 is lost."""

    class Interrupted(FakeEpisodes):
        def inject(self, item, where) -> None:
            if item.seed == 0:
                while not run_file(tmp_path, items(2)[1].run_ids[0]).exists():
                    time.sleep(0.01)
                time.sleep(0.5)  # The parent takes note of item 1.
                os.kill(os.getppid(), signal.SIGINT)
                time.sleep(60)

    results = run_items(items(2), tmp_path, workers=2, make=Interrupted())
    assert next(results).item.seed == 1
    with pytest.raises(KeyboardInterrupt):
        next(results)


def test_a_lost_episode_leaves_no_gap_between_the_names(tmp_path):
    """One that has nothing to save gives its name to the next."""
    make = FakeEpisodes({(key_of(items(1)[0]), PLACING): ("exit",)})

    class NothingWritten(FakeEpisodes):
        def __call__(self, item, on_start):
            if item.seed == 0:
                os._exit(7)
            return make(item, on_start)

    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=CONFIG.robot_spec, cloth="napkin") as recorder:
        found = collected(recorder, items(3), tmp_path, NothingWritten())
    assert [row["seed"] for row in found.lost] == [0]
    with open_session(path) as session:
        assert session.names == ("demo_0", "demo_1")
    assert validate(path) == ()


def test_a_worker_that_dies_between_saving_and_reporting_loses_nothing(tmp_path, monkeypatch):
    save = JournalHandle.save

    def save_and_die(handle: JournalHandle, episode: Episode) -> None:
        save(handle, episode)
        handle.path.touch()  # The journal is removed after the episode is durable.
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(JournalHandle, "save", save_and_die)
    path, saved = tmp_path / "s.h5", []
    with SessionRecorder(path, robot=CONFIG.robot_spec, cloth="napkin") as recorder:
        found = collected(recorder, items(1), tmp_path, FakeEpisodes(), on_saved=saved.append)
    assert [(episode.name, episode.outcome, episode.n_steps) for episode in saved] == [("demo_0", "success", 3)]
    assert len(found.rows) + len(found.lost) == 1
    with open_session(path) as session:
        assert [info.outcome for info in session.infos().values()] == ["success"]
    assert not parts_folder(path).exists()


def test_images_that_the_session_does_not_keep_are_in_a_file_beside_it(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    tasks = demonstrations(CONFIG, [0], keep_images=True)
    with SessionRecorder(tmp_path / "s.h5", robot=CONFIG.robot_spec, cloth="napkin") as recorder:
        found = collected(recorder, tasks, folder, FakeEpisodes())
    assert run_file(folder, found.runs[0]).exists()
    assert validate(tmp_path / "s.h5") == ()
