"""A take in a process of its own, forked from one that has never stepped a simulation.

Bullet is only reproducible there (as in ``app/workers/episode_pool.py``): otherwise no recorded episode but the first
could be
replayed. A crash costs one take, whose journal gives back all but its last moments. The parent may have windows and
pads open: the fork server is a process beside it, which has neither.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any, TypeAlias

from layflat.app.workstation.session.episode_handle import EpisodeHandle, EpisodeLost, EpisodeStatus, HandleFactory
from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.app.workstation.teleop.teleop_policy import TeleopPolicy
from layflat.data.errors import DataError
from layflat.data.session.journal import JournalHandle, JournalWriter
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Episode, Outcome, StoppedBy
from layflat.policy import registry
from layflat.policy.base import Policy, PolicyError
from layflat.policy.runner import EpisodeRunner
from layflat.policy.trained_model import TrainedModel
from layflat.policy.wrappers.takeover import MotionTakeoverTrigger, TakeoverPolicy
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError
from layflat.sim.simulation import ClothSimulation

ANSWER_S = 60.0
"""A step that takes longer will never end."""
GONE_S = 5.0
"""A process that is asked to end has so long."""

OnStep: TypeAlias = Callable[[EpisodeRunner, TeleopInput], None]
"""Called in the take's process when its cloth hangs and after each step, with what was read for it. Picklable."""


@dataclass(frozen=True, kw_only=True)
class InteractiveEpisodeConfig:
    """Everything that determines a take, but for what the person does."""

    settings: SimConfig
    seed: int
    source: str
    ticket: JournalHandle
    attend: OnStep | None = None
    model: TrainedModel | None = None
    """Who places; the person takes over when their hands move, and hands back when they rest."""


class EpisodeProcess:
    """The parent's end."""

    def __init__(
        self, job: InteractiveEpisodeConfig, recorder: SessionRecorder, context: BaseContext | None = None
    ) -> None:
        """Returns at once; the cloth is hung meanwhile.

        ``context``: how processes are made, where the parent knows better: one that has neither windows nor threads,
        and has never stepped a simulation, may fork at once.
        """
        self.seed = job.seed
        self._ticket = job.ticket
        self._recorder = recorder
        context = context or _forkserver()
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(  # type: ignore[attr-defined]
            target=serve, args=(job, theirs), name=f"take of seed {job.seed}", daemon=True
        )
        self._process.start()
        theirs.close()
        self._glance: EpisodeStatus | None = None

    def ready(self) -> bool:
        if self._glance is None and self._pipe.poll():
            self._glance = self._answer()
        return self._glance is not None

    def glance(self) -> EpisodeStatus:
        return self._glance or EpisodeStatus()

    def step(self, reading: TeleopInput, pull: DragTarget | None = None) -> EpisodeStatus:
        self._ask("step", reading.heard(), pull)
        self._glance = self._answer()
        return self._glance

    def disturb(self, name: str) -> None:
        self._ask("disturb", name)
        self._glance = self._answer()

    def hand_back(self) -> None:
        self._ask("hand back")
        self._glance = self._answer()

    def keep(self, outcome: Outcome, stopped_by: StoppedBy) -> SavedEpisode | None:
        with contextlib.suppress(EpisodeLost):  # Then the journal has what there is, as partial.
            self._ask("end", outcome, stopped_by)
            while self._receive() != "ended":
                pass
        self._end(GONE_S)
        return self._recorder.recover(self._ticket, stopped_by=stopped_by if outcome == "partial" else "crashed")

    def discard(self) -> None:
        self._end(0.0)
        self._recorder.discard(self._ticket)

    def _ask(self, *command: Any) -> None:
        try:
            self._pipe.send(command)
        except OSError as error:
            raise self._lost() from error

    def _answer(self) -> EpisodeStatus:
        answer = self._receive()
        if isinstance(answer, EpisodeStatus):
            return answer
        raise EpisodeLost(str(answer))

    def _receive(self) -> Any:
        try:
            if not self._pipe.poll(ANSWER_S):
                raise EpisodeLost(f"the simulation of seed {self.seed} has not answered for {ANSWER_S:.0f} s")
            return self._pipe.recv()
        except (EOFError, OSError) as error:
            raise self._lost() from error

    def _lost(self) -> EpisodeLost:
        self._process.join(GONE_S)
        return EpisodeLost(f"the simulation of seed {self.seed} ended by itself with status {self._process.exitcode}")

    def _end(self, patience_s: float) -> None:
        self._process.join(patience_s)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()


def make_handle_factory(
    recorder: SessionRecorder,
    settings: SimConfig,
    source: str,
    *,
    attend: OnStep | None = None,
    context: BaseContext | None = None,
    model: TrainedModel | None = None,
) -> HandleFactory:
    """Makes the takes of a recording."""

    def begin(seed: int) -> EpisodeHandle:
        job = InteractiveEpisodeConfig(
            settings=settings, seed=seed, source=source, ticket=recorder.new_journal(), attend=attend, model=model
        )
        return EpisodeProcess(job, recorder, context)

    return begin


def _forkserver() -> BaseContext:
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    return context


class EpisodeWorker:
    """A take in this process, as far as its journal: the child's end."""

    def __init__(self, job: InteractiveEpisodeConfig) -> None:
        self._journal: JournalWriter | None = None
        self._reading = zero_input(job.settings.robot_spec)
        self._bench = ClothSimulation(job.settings)
        self._bench.reset(job.seed)
        policy: Policy = TeleopPolicy(job.settings.robot_spec, job.source, lambda: self._reading)
        self._grip = MotionTakeoverTrigger(lambda: self._reading.moving)
        if job.model is not None:
            policy = TakeoverPolicy(registry.from_model(job.model), policy, self._grip)

        def journal(beginning: Episode) -> JournalWriter:
            self._journal = job.ticket.open(beginning)
            return self._journal

        images = job.ticket.save_images
        self._run = EpisodeRunner(self._bench, policy, seed=job.seed, keep_images=images, on_start=journal)
        self._attend = job.attend
        self._show()

    def _show(self) -> None:
        if self._attend is not None:
            self._attend(self._run, self._reading)

    def glance(self, stopped_by: StoppedBy | None = None) -> EpisodeStatus:
        seen, run = self._run.observation, self._run
        return EpisodeStatus(
            n_steps=run.n_steps,
            time_s=seen.time_s,
            contact_portion=seen.contact_portion,
            word=(float(seen.word[0]), float(seen.word[1])),
            holder_m=(float(seen.holder_position[0]), float(seen.holder_position[1]), float(seen.holder_position[2])),
            flat_area=0.0 if run.ground_truth is None else run.ground_truth.flat_area,
            stopped_by=stopped_by,
            disturbed=run.disturbed,
            led=isinstance(run.policy, TakeoverPolicy) and run.policy.human_in_control,
        )

    def obey(self, command: str, *details: Any) -> object:
        """Carry out ``step``, ``disturb``, ``hand back`` or ``end``; returns what the parent is to be told."""
        commands: dict[str, Callable[..., object]] = {
            "step": self.step,
            "disturb": self.disturb,
            "hand back": self.hand_back,
            "end": self.end,
        }
        return commands[command](*details)

    def step(self, reading: TeleopInput, pull: DragTarget | None = None) -> EpisodeStatus:
        self._reading = reading
        stopped_by = self._run.step("place", drag=pull)
        self._show()
        return self.glance(stopped_by)

    def disturb(self, name: str) -> EpisodeStatus:
        self._run.disturb(name)
        return self.glance()

    def hand_back(self) -> EpisodeStatus:
        self._grip.release()
        return self.glance()

    def end(self, outcome: Outcome, stopped_by: StoppedBy) -> str:
        """The journal holds the whole episode afterwards."""
        if self._journal is not None:
            self._journal.finish(self._run.build_episode(stopped_by, outcome))
        return "ended"

    def close(self) -> None:
        if self._journal is not None:
            self._journal.close()
        self._bench.close()


def serve(job: InteractiveEpisodeConfig, pipe: Connection) -> None:
    """The life of a take's process."""
    _settle_in()
    take: EpisodeWorker | None = None
    try:
        take = EpisodeWorker(job)
        pipe.send(take.glance())
        answer: object = None
        while answer != "ended":
            command, *details = pipe.recv()
            answer = take.obey(command, *details)
            pipe.send(answer)
    except (SimError, DataError, PolicyError) as error:
        with contextlib.suppress(OSError):
            pipe.send(str(error))
    except (EOFError, OSError):
        pass  # The recording is gone. The journal keeps what there is.
    finally:
        if take is not None:
            take.close()
        pipe.close()


def _settle_in() -> None:
    # Ctrl-C reaches the whole process group; only the parent decides what to keep.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # One that is forked has its parent's way with it, which is none here.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform == "linux":
        # A parent that is killed cannot end its takes. The fork server ends with it, and these with that.
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    import cv2

    cv2.setNumThreads(1)
