"""An interactive episode in a process of its own, forked from one that has never stepped a simulation.

Bullet is only reproducible there: otherwise only the first recorded episode could be replayed. A crash costs one
episode, whose journal restores all but its last moments. The parent may have windows and gamepads open: the fork server
is a process beside it, which has neither.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any, TypeAlias

from layflat.app.support.child_python import fork_server_context
from layflat.app.workers.process import configure_child, describe_exit_status
from layflat.app.workstation.session.episode_handle import EpisodeHandle, EpisodeLost, EpisodeStatus, HandleFactory
from layflat.app.workstation.session.frame_channel import FrameChannel
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
"""Time after which a step counts as hung."""
EXIT_S = 5.0
"""Time for a process to end when it is asked to."""

OnStep: TypeAlias = Callable[[ClothSimulation, EpisodeRunner, TeleopInput], None]
"""Called in the episode's process when its cloth hangs and after each step, with the step's input. Picklable."""


@dataclass(frozen=True, kw_only=True)
class InteractiveEpisodeConfig:
    """Everything that determines an episode, except for what the person does."""

    sim_config: SimConfig
    seed: int
    source: str
    journal: JournalHandle
    on_step: OnStep | None = None
    model: TrainedModel | None = None
    """Policy in control; the person takes over when they move, and returns control when they rest."""


class EpisodeProcess:
    """The parent's end of an episode."""

    def __init__(self, config: InteractiveEpisodeConfig, recorder: SessionRecorder, context: BaseContext) -> None:
        """Return at once; the cloth is hung meanwhile."""
        self.seed = config.seed
        self._journal = config.journal
        self._recorder = recorder
        self._connection, theirs = context.Pipe()
        self._process = context.Process(  # type: ignore[attr-defined]
            target=serve, args=(config, theirs), name=f"episode of seed {config.seed}", daemon=True
        )
        self._process.start()
        theirs.close()
        self._status: EpisodeStatus | None = None

    @property
    def pid(self) -> int:
        """Number of the process."""
        return int(self._process.pid)

    def ready(self) -> bool:
        """Return whether the cloth hangs; never wait."""
        if self._status is None and self._connection.poll():
            self._status = self._receive_status()
        return self._status is not None

    def status(self) -> EpisodeStatus:
        """Return the state after the last step."""
        return self._status or EpisodeStatus()

    def step(self, teleop: TeleopInput, drag: DragTarget | None = None) -> EpisodeStatus:
        """Run one step and wait for it."""
        return self._request("step", teleop.without_commands(), drag)

    def disturb(self, name: str) -> None:
        """Start a named disturbance with the next step."""
        self._request("disturb", name)

    def release_control(self) -> None:
        """Return control to the policy with the next step."""
        self._request("release_control")

    def save(self, outcome: Outcome, stopped_by: StoppedBy) -> SavedEpisode | None:
        """End the episode and save it; after a crash, save the steps that its journal has, as partial."""
        with contextlib.suppress(EpisodeLost):
            self._send("end", outcome, stopped_by)
            while self._receive() != "ended":
                pass
        self._end(EXIT_S)
        return self._recorder.recover(self._journal, stopped_by=stopped_by if outcome == "partial" else "crashed")

    def discard(self) -> None:
        """End the episode and delete its steps."""
        self._end(0.0)
        self._recorder.discard(self._journal)

    def _request(self, *request: Any) -> EpisodeStatus:
        self._send(*request)
        self._status = self._receive_status()
        return self._status

    def _send(self, *request: Any) -> None:
        try:
            self._connection.send(request)
        except OSError as error:
            raise self._lost() from error

    def _receive_status(self) -> EpisodeStatus:
        answer = self._receive()
        if isinstance(answer, EpisodeStatus):
            return answer
        raise EpisodeLost(str(answer))

    def _receive(self) -> Any:
        try:
            if not self._connection.poll(ANSWER_S):
                raise EpisodeLost(f"the simulation of seed {self.seed} has not answered for {ANSWER_S:.0f} s")
            return self._connection.recv()
        except (EOFError, OSError) as error:
            raise self._lost() from error

    def _lost(self) -> EpisodeLost:
        self._process.join(EXIT_S)
        return EpisodeLost(
            f"the simulation of seed {self.seed} was lost: {describe_exit_status(self._process.exitcode, EXIT_S)}"
        )

    def _end(self, patience_s: float) -> None:
        self._process.join(patience_s)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._connection.close()


def make_handle_factory(
    recorder: SessionRecorder,
    sim_config: SimConfig,
    source: str,
    *,
    on_step: OnStep | None = None,
    model: TrainedModel | None = None,
    context: BaseContext | None = None,
) -> HandleFactory:
    """Return what makes the episodes of a recording.

    ``context`` makes their processes. A caller that has neither windows nor threads and has never stepped a simulation
    may pass one that forks; the default is a fork server.
    """
    made = fork_server_context([__name__]) if context is None else context

    def make_episode(seed: int) -> EpisodeHandle:
        config = InteractiveEpisodeConfig(
            sim_config=sim_config,
            seed=seed,
            source=source,
            journal=recorder.new_journal(),
            on_step=on_step,
            model=model,
        )
        return EpisodeProcess(config, recorder, made)

    return make_episode


class EpisodeWorker:
    """The child's end of an episode, up to its journal."""

    def __init__(self, config: InteractiveEpisodeConfig) -> None:
        robot = config.sim_config.robot_spec
        self._journal: JournalWriter | None = None
        self._on_step = config.on_step
        self._teleop = zero_input(robot)
        self._sim = ClothSimulation(config.sim_config)
        self._sim.reset(config.seed)
        policy: Policy = TeleopPolicy(robot, config.source, lambda: self._teleop)
        self._trigger = MotionTakeoverTrigger(lambda: self._teleop.moving)
        if config.model is not None:
            policy = TakeoverPolicy(registry.from_model(config.model), policy, self._trigger)

        def open_journal(beginning: Episode) -> JournalWriter:
            self._journal = config.journal.open(beginning)
            return self._journal

        keep_images = config.journal.save_images
        self._run = EpisodeRunner(self._sim, policy, seed=config.seed, keep_images=keep_images, on_start=open_journal)
        self._report()

    def _report(self) -> None:
        if self._on_step is not None:
            self._on_step(self._sim, self._run, self._teleop)

    def status(self, stopped_by: StoppedBy | None = None) -> EpisodeStatus:
        """Return the state after the last step."""
        run, seen = self._run, self._run.observation
        x, y, z = seen.holder_position.tolist()
        return EpisodeStatus(
            n_steps=run.n_steps,
            time_s=seen.time_s,
            contact_portion=seen.contact_portion,
            holder_m=(x, y, z),
            flat_area=0.0 if run.ground_truth is None else run.ground_truth.flat_area,
            stopped_by=stopped_by,
            disturbed=run.disturbed,
            human_in_control=isinstance(run.policy, TakeoverPolicy) and run.policy.human_in_control,
        )

    def handle_request(self, name: str, *details: Any) -> object:
        """Run ``step``, ``disturb``, ``release_control`` or ``end``; return the answer for the parent."""
        known = (self.step, self.disturb, self.release_control, self.end)
        return {method.__name__: method for method in known}[name](*details)

    def step(self, teleop: TeleopInput, drag: DragTarget | None = None) -> EpisodeStatus:
        """Run one step."""
        self._teleop = teleop
        stopped_by = self._run.step("place", drag)
        self._report()
        return self.status(stopped_by)

    def disturb(self, name: str) -> EpisodeStatus:
        """Start a disturbance."""
        self._run.disturb(name)
        return self.status()

    def release_control(self) -> EpisodeStatus:
        """Return control to the policy."""
        self._trigger.release()
        return self.status()

    def end(self, outcome: Outcome, stopped_by: StoppedBy) -> str:
        """Complete the journal, which then holds the whole episode."""
        if self._journal is not None:
            self._journal.finish(self._run.build_episode(stopped_by, outcome))
        return "ended"

    def close(self) -> None:
        """Close journal and simulation."""
        if self._journal is not None:
            self._journal.close()
        self._sim.close()


def serve(config: InteractiveEpisodeConfig, connection: Connection) -> None:
    """Serve one episode in this process."""
    configure_child()
    worker: EpisodeWorker | None = None
    try:
        worker = EpisodeWorker(config)
        connection.send(worker.status())
        answer: object = None
        while answer != "ended":
            name, *details = connection.recv()
            answer = worker.handle_request(name, *details)
            connection.send(answer)
    except (SimError, DataError, PolicyError) as error:
        with contextlib.suppress(OSError):
            connection.send(str(error))
    except (EOFError, OSError):
        pass  # The recording has ended. The journal keeps the steps.
    finally:
        if worker is not None:
            worker.close()
        connection.close()


@dataclass(frozen=True)
class FramePublisher:
    """Callback of an episode's process that publishes each step."""

    channel: FrameChannel

    def __call__(self, sim: ClothSimulation, run: EpisodeRunner, teleop: TeleopInput) -> None:
        """Publish the state after a step on ``teleop``, or before the first step."""
        work_s = time.monotonic() - teleop.stamp_s if teleop.stamp_s else 0.0
        self.channel.publish(sim, run, input_s=teleop.stamp_s if run.steps else 0.0, work_s=work_s)
