"""Placing as the bench process does it: a policy places the cloth, and whoever watches may disturb it at any time."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Literal, TypeAlias

from app.jobs import EpisodeJob, policy_of
from app.record import kept_line
from app.run import Run
from app.workstation.cadence import Cadence
from app.workstation.host import IDLE_S, Desk, Order
from data.recorder import SessionRecorder
from data.running import Running
from data.types import Episode, Phase, Pull, StoppedBy
from policy import model as model_files
from policy.learned import Learned
from sim.placing import BenchSettings, Placing

State: TypeAlias = Literal["ready", "placing", "placed", "disturbing", "repairing", "over"]
PHASES: dict[State, Phase] = {"placing": "place", "disturbing": "disturb", "repairing": "repair"}
SCRIPTED = "scripted"
LIMIT_TICKS: dict[State, int] = {"placing": 160, "disturbing": 600, "repairing": 80}
"""Ticks after which a phase is over although nobody has ended it; a person may pull for a minute."""
SETTLE_TICKS = 10
"""Ticks that the cloth is given after the mouse has let go, as after any disturbance."""


class PlacingWork:
    """One episode of a policy.

    The order: ``task, cloth, seed, policy`` (``scripted``, a name that needs no training, or the path of a model),
    ``descriptor, noise, tick_s, speed, hurry`` (as fast as it goes until the cloth is placed), ``record`` (a session's
    path, or empty) and ``images``.
    """

    def __init__(self, order: Order, desk: Desk) -> None:
        self._order = order
        self._desk = desk
        model = model_of(str(order["policy"]))
        settings = settings_of(order, descriptor=None if model is None else model.descriptor)
        self._recorder = recorder_of(order, settings)
        self.over = False
        self.state: State = "ready"
        self.paused = False
        self.message = ""
        self._stopped_by: StoppedBy = "interrupted"
        self._running: Running | None = None
        self._settle = 0
        self._phase_ticks = 0
        self._repeats = 0
        self._pulled = 0
        self._last = {"input_s": 0.0, "work_s": 0.0}
        self._cadence = self._paced()
        self.bench = Placing(settings)
        self.bench.reset(int(order["seed"]))
        made = None if model is not None or order["policy"] == SCRIPTED else str(order["policy"])
        job = EpisodeJob(task=settings.task, cloth=settings.cloth, seed=int(order["seed"]), model=model, made=made)
        begin = None if self._recorder is None else self._begin
        self.run = Run(
            self.bench,
            policy_of(job, self.bench),
            seed=job.seed,
            images=bool(order.get("images")),
            begin=begin,
        )
        self._tell()

    def _begin(self, beginning: Episode) -> Running:
        assert self._recorder is not None
        self._running = self._recorder.begin(beginning)
        return self._running

    def obey(self, order: Order) -> None:
        """``start``, ``pause``, ``disturb`` (with a ``name``), ``keep``, ``discard``."""
        do = order["do"]
        if do == "start" and self.state == "ready":
            self._turn("placing")
        elif do in ("pause", "start"):
            self.paused = do == "pause" and not self.paused
        elif do == "disturb" and self.state not in ("ready", "over"):
            self._disturb(str(order["name"]))
        elif do == "keep":
            self._keep()
        elif do == "discard":
            self._discard()

    def advance(self) -> float:
        letter = self._desk.letter()
        pull = None if letter is None else letter.pull
        if self.state == "placed" and pull is not None and not self.paused:
            self._turn("disturbing")
            self.message = "a hand pulls at the cloth"
        if self.paused or self.state not in PHASES:
            self._cadence.pause()
            return IDLE_S
        left_s = self._cadence.left_s()
        if left_s > 0:
            return left_s
        self._cadence.begin()
        began = time.monotonic()
        # Looked at again: what came while the tick was waited for counts already.
        letter = self._desk.letter()
        pull = None if letter is None else letter.pull
        stop = self._tick(pull)
        self._last = {"input_s": 0.0 if letter is None else letter.stamp_s, "work_s": time.monotonic() - began}
        self._cadence.end()
        self._tell()
        self._follow(stop, pull)
        return 0.0

    def _tick(self, pull: Pull | None) -> StoppedBy | None:
        self._phase_ticks += 1
        self._pulled += pull is not None
        if self._phase_ticks > LIMIT_TICKS[self.state]:
            return "tick_limit"
        return self.run.tick(PHASES[self.state], pull=pull)

    def _follow(self, stop: StoppedBy | None, pull: Pull | None) -> None:
        """What comes after a tick."""
        if stop == "unstable":
            self._stopped_by, self.message = stop, "the cloth became unstable, which ends this episode"
            self._turn("over")
        elif self.state == "disturbing":
            self._settle = SETTLE_TICKS if pull is not None else self._settle - 1
            if stop is not None or (self._settle <= 0 and not self.run.disturbed):
                self.run.policy.resume()
                self._turn("repairing")
                self.message = f"{self.run.policy.name} goes on"
        elif stop is not None and pull is None and not self.run.disturbed:
            self._stopped_by = stop
            contact = 100 * self.run.seen.contact_portion
            self.message = f"stopped by {stop.replace('_', ' ')}, contact {contact:.0f} %"
            self._turn("placed")
        elif stop is not None:
            # It has stopped while something still moves the cloth: waited for, and then it goes on.
            self._turn("disturbing")

    def _turn(self, state: State) -> None:
        self.state, self._phase_ticks, self._settle = state, 0, SETTLE_TICKS if state == "disturbing" else 0
        if state == "placed" and self._order.get("hurry"):
            self._order = {**self._order, "hurry": False}
            self._cadence = self._paced()

    def _paced(self) -> Cadence:
        speed = 0.0 if self._order.get("hurry") else float(self._order["speed"])
        return Cadence(float(self._order["tick_s"]), speed)

    def _disturb(self, name: str) -> None:
        self.run.disturb(name, self._repeats)
        self._repeats += 1
        self.message = f"{name}: begins now"
        if self.state in ("placed", "disturbing"):
            self._turn("disturbing")
            self._settle = 0

    def _keep(self) -> None:
        if self._running is None:
            self.message = "nothing is recorded: give a session file before placing"
            return
        episode = self.run.episode(self._stopped_by)
        kept = self._running.keep(episode)
        self._running, self.over = None, True
        self._desk.tell("kept", line=kept_line(kept), outcome=kept.outcome)

    def _discard(self) -> None:
        if self._running is not None:
            self._running.discard()
            self._running = None
        self.over = True
        self._desk.tell("discarded", line=f"discarded seed {self.run.seed}")

    def _tell(self) -> None:
        self._desk.channels.moments.tell(
            self.bench,
            self.run.seen,
            self.run.truth,
            episode=1,
            tick=self.run.ticks,
            phase=PHASES.get(self.state, "place"),
            **self._last,
        )

    def status(self) -> dict[str, Any]:
        rhythm = self._cadence.rhythm()
        return {
            "state": self.state,
            "paused": self.paused,
            "policy": self.run.policy.name,
            "seed": self.run.seed,
            "ticks": self.run.ticks,
            "message": self.message,
            "recording": self._recorder is not None,
            "pulled_ticks": self._pulled,
            "disturbances": [record.name for record in self.run.disturbances],
            "rhythm": rhythm.told(),
            "factor": rhythm.factor(float(self._order["tick_s"])),
            "flat_area": self.run.truth.flat_area,
        }

    def close(self) -> None:
        """An episode that nobody has judged is kept as partial, where it is recorded at all."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            if self._running is not None and not self.run.ticks:
                self._running.discard()
            recorder.close()
        self.bench.close()


def model_of(policy: str) -> Learned | None:
    """The model of a path; None for a policy that has none."""
    return model_files.load(Path(policy)) if policy.endswith(".npz") else None


def settings_of(order: Order, *, descriptor: str | None) -> BenchSettings:
    return BenchSettings(
        task=order["task"],
        cloth=str(order["cloth"]),
        descriptor=descriptor or str(order["descriptor"]),
        noise=bool(order["noise"]),
        tick_s=float(order["tick_s"]),
    )


def recorder_of(order: Order, settings: BenchSettings) -> SessionRecorder | None:
    """Where the order records; DataError where that session holds something else."""
    path = str(order.get("record") or "")
    if not path:
        return None
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    return SessionRecorder(
        path,
        task=settings.task,
        cloth=settings.cloth,
        keep_images=bool(order.get("images")),
        descriptor=settings.descriptor,
    )
