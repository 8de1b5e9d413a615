"""An interactive episode in a process of its own, forked from one that has never stepped a simulation.

Bullet is only reproducible there: otherwise only the first recorded episode could be replayed. A crash costs one
episode, whose journal restores all but its last moments. The child saves its own episode; the parent never waits.
"""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any

import numpy as np

from layflat.app.workers.process import configure_child, describe_exit_status
from layflat.app.workstation.session.episode import EpisodeHandle, EpisodeLost
from layflat.app.workstation.session.frame_channel import SimulationFrame, frame_of
from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import EpisodeStatus
from layflat.app.workstation.session.verdict import judge
from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.app.workstation.teleop.teleop_policy import TeleopPolicy
from layflat.data.arrays import FloatArray
from layflat.data.environment_spec import StepLimits
from layflat.data.errors import DataError
from layflat.data.session.journal import JournalHandle, JournalWriter
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Episode, Outcome, Phase, StoppedBy
from layflat.policy.base import Policy, PolicyError, continue_after_disturbance, max_extra_steps
from layflat.policy.runner import EpisodeRunner
from layflat.policy.wrappers.takeover import MotionTakeoverTrigger, TakeoverPolicy
from layflat.sim.errors import SimError
from layflat.sim.simulation import ClothSimulation

ANSWER_S = 60.0
"""Time after which a step counts as hung."""
EXIT_S = 5.0
"""Time for a process to end that has closed its connection."""


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig:
    """Everything that determines an episode, except for what the person does."""

    request: SessionRequest
    seed: int
    journal: JournalHandle | None
    """Journal, where the episode is recorded."""
    frames: LatestValue[SimulationFrame] | None = None


class EpisodeProcess(EpisodeHandle):
    """The session's end of an episode."""

    def __init__(self, config: EpisodeConfig, recorder: SessionRecorder | None, context: BaseContext) -> None:
        """Return at once; the cloth is hung meanwhile."""
        self.seed = config.seed
        self._journal, self._recorder = config.journal, recorder
        self._asked: list[str] = ["hang"]
        """What is not done yet."""
        self._answered_s = time.monotonic()
        self.connection, theirs = context.Pipe()
        self._process = context.Process(  # type: ignore[attr-defined]
            target=serve, args=(config, theirs), name=f"episode of seed {config.seed}", daemon=True
        )
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return int(self._process.pid)

    @property
    def busy(self) -> bool:
        """Whether something that was asked for is not done yet."""
        return bool(self._asked)

    def poll(self) -> bool:
        """Take what has come; return whether a step is done."""
        stepped = False
        try:
            while not self.ended and self.connection.poll():
                answer = self.connection.recv()
                done, self._answered_s = self._asked.pop(0), time.monotonic()
                if isinstance(answer, EpisodeStatus):
                    self.status, stepped = answer, stepped or done == "step"
                elif isinstance(answer, str):
                    raise EpisodeLost(answer)
                else:
                    self._finish(answer)
        except (EOFError, OSError) as error:
            self._process.join(EXIT_S)
            how = describe_exit_status(self._process.exitcode, EXIT_S)
            raise EpisodeLost(f"the simulation of seed {self.seed} was lost: {how}") from error
        if self._asked and not self.ended and time.monotonic() - self._answered_s > ANSWER_S:
            raise EpisodeLost(f"the simulation of seed {self.seed} has not answered for {ANSWER_S:.0f} s")
        return stepped

    def recover(self) -> SavedEpisode | None:
        """Save the steps that the journal has."""
        self.kill()
        if self._recorder is None or self._journal is None:
            return None
        return self._recorder.recover(self._journal, stopped_by="crashed")

    def discard(self) -> None:
        """End the episode and delete its steps."""
        if not self.connection.closed:
            self.kill()
            if self._recorder is not None and self._journal is not None:
                self._recorder.discard(self._journal)

    def kill(self) -> None:
        """End the process; the journal, where there is one, keeps its steps."""
        if not self.connection.closed:
            self._process.kill()
            self._process.join()
            self.connection.close()

    def ask(self, name: str, *details: Any) -> None:
        """Ask for something by its name."""
        if not self._asked:
            self._answered_s = time.monotonic()
        self._asked.append(name)
        with contextlib.suppress(OSError):  # `poll` reports a process that has ended.
            self.connection.send((name, *details))

    def _finish(self, saved: SavedEpisode | None) -> None:
        self.kill()
        self.ended = True
        if self._recorder is not None and saved is not None:
            self.saved = self._recorder.register(saved)
        elif self._recorder is not None and self._journal is not None:
            self._recorder.discard(self._journal)


class EpisodeWorker:
    """The child's end of an episode."""

    def __init__(self, config: EpisodeConfig) -> None:
        request = config.request
        self._config = config
        self._journal: JournalWriter | None = None
        self._teleop = zero_input(request.sim_config.robot_spec)
        self._trigger = MotionTakeoverTrigger(lambda: self._teleop.moving)
        self._sim = ClothSimulation(request.sim_config.under(request.variation.sample(config.seed)))
        self._sim.reset(config.seed)
        self._policy = None if request.policy is None else request.policy.make(self._sim)
        journal = config.journal
        images, on_start = (False, None) if journal is None else (journal.save_images, self._open_journal)
        self._run = EpisodeRunner(self._sim, self._decider(), seed=config.seed, keep_images=images, on_start=on_start)
        self._n_interventions, self._work_s = 0, 0.0
        self._show()

    def _open_journal(self, beginning: Episode) -> JournalWriter:
        assert self._config.journal is not None
        self._journal = self._config.journal.open(beginning)
        return self._journal

    def _decider(self) -> Policy:
        """Return the person, the policy, or the policy from which the person takes over."""
        policy, source = self._policy, self._config.request.source
        if policy is not None and not source:
            return policy
        person = TeleopPolicy(self._sim.config.robot_spec, source, lambda: self._teleop)
        if policy is None:
            return person
        # Without its device a person is never in control.
        return TakeoverPolicy(policy, person, lambda: self._trigger() if self._teleop.connected else "release")

    def answer(self, name: str, *details: Any) -> EpisodeStatus | SavedEpisode | None:
        """Do what was asked for, by its name, and return the answer for the session."""
        stopped_by = None
        match name:
            case "save":
                return self._save(*details)
            case "step":
                stopped_by = self._step(*details)
            case "disturb":
                self._run.disturb(*details)
            case "release_control":
                self._trigger.release()
            case "proceed":
                continue_after_disturbance(self._run.policy)
            case "show":
                self._show()
        return self.status(stopped_by)

    def status(self, stopped_by: StoppedBy | None = None) -> EpisodeStatus:
        """Return the state after the last step."""
        run, seen, policy = self._run, self._run.observation, self._policy
        flat_area = 0.0 if run.ground_truth is None else run.ground_truth.flat_area
        success = stopped_by != "unstable" and self._sim.success()
        limits, extra = self._sim.spec.limits, 0 if policy is None else max_extra_steps(policy)
        return EpisodeStatus(
            steps=run.n_steps,
            time_s=seen.time_s,
            contact=seen.contact_portion,
            flat_area=flat_area,
            verdict=judge(seen.contact_portion, flat_area, success, self._nodes()),
            stopped_by=stopped_by,
            disturbed=run.disturbed,
            human_in_control=isinstance(run.policy, TakeoverPolicy) and run.policy.human_in_control,
            intervention_steps=self._n_interventions,
            disturbances=tuple(record.name for record in run.disturbances),
            policy="" if policy is None else policy.name,
            limits=StepLimits(place=limits.place + extra, repair=limits.repair + extra, disturb=limits.disturb),
        )

    def _nodes(self) -> FloatArray | None:
        truth, shape = self._run.ground_truth, self._sim.spec.cloth_shape
        if truth is None or shape is None or len(truth.nodes) != shape.rows * shape.columns:
            return None
        return np.reshape(truth.nodes, (shape.rows, shape.columns, 3))

    def _step(self, phase: Phase, teleop: TeleopInput, drag: DragTarget | None) -> StoppedBy | None:
        self._teleop, n_steps, started_s = teleop, self._run.n_steps, time.monotonic()
        stopped_by = self._run.step(phase, drag)
        if self._run.n_steps > n_steps:
            self._work_s = time.monotonic() - started_s
            self._n_interventions += self._run.steps[-1].intervention
            self._show()
        return stopped_by

    def _show(self) -> None:
        if self._config.frames is not None:
            stamp_s = self._teleop.stamp_s if self._run.steps else 0.0
            self._config.frames.write(frame_of(self._sim, self._run, input_s=stamp_s, work_s=self._work_s))

    def _save(self, outcome: Outcome, stopped_by: StoppedBy) -> SavedEpisode | None:
        """Save the episode, durable on return; None where it has no steps."""
        if self._journal is None or self._config.journal is None or not self._run.n_steps:
            return None
        episode = self._run.build_episode(stopped_by, outcome)
        # From here on the journal holds the whole episode, too.
        self._journal.finish(episode)
        return self._config.journal.save(episode)

    def close(self) -> None:
        """Close journal and simulation."""
        if self._journal is not None:
            self._journal.close()
        self._sim.close()


def serve(config: EpisodeConfig, connection: Connection) -> None:
    """Serve one episode in this process."""
    configure_child()
    worker: EpisodeWorker | None = None
    try:
        worker = EpisodeWorker(config)
        connection.send(worker.status())
        name = ""
        while name != "save":
            name, *details = connection.recv()
            connection.send(worker.answer(name, *details))
    except (SimError, DataError, PolicyError) as error:
        with contextlib.suppress(OSError):
            connection.send(str(error))
    except (EOFError, OSError):
        pass  # The session has ended. The journal keeps the steps.
    finally:
        if worker is not None:
            worker.close()
        connection.close()
