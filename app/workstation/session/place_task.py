"""ClothSimulation as the bench process does it: a policy places the cloth, and whoever watches may disturb it at any
time."""

from __future__ import annotations

import time
from typing import Any, Literal, TypeAlias

from layflat.app.support.session_lines import kept_line
from layflat.app.workstation.session.bench_process import IDLE_S, Endpoint, Request
from layflat.app.workstation.session.control_actions import OUTCOMES
from layflat.app.workstation.session.input_channel import InputSample
from layflat.app.workstation.session.intervention import YOU, InterventionController
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.session.recording_session import JUDGED
from layflat.app.workstation.session.requests import model_of, recorder_of, settings_of
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data.session.recorder import EpisodeWriter
from layflat.data.types import DragTarget, Episode, Outcome, Phase, StoppedBy
from layflat.policy.base import continue_after_disturbance, max_extra_steps
from layflat.policy.runner import EpisodeRunner
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.simulation import ClothSimulation

State: TypeAlias = Literal["ready", "placing", "placed", "disturbing", "repairing", "over"]
PHASES: dict[State, Phase] = {"placing": "place", "disturbing": "disturb", "repairing": "repair"}
LIMIT_STEPS: dict[State, int] = {"placing": 160, "disturbing": 600, "repairing": 80}
"""Steps after which a phase is over although nobody has ended it; a person may pull for a minute."""
SETTLE_STEPS = 10
"""Steps that the cloth is given after the mouse has let go, as after any disturbance."""
DISTURBANCE = "push"
"""What a device's button for it begins; the others have keys."""
NOT_RECORDED = "nothing is recorded: give a session file before placing"


class PlaceTask:
    """One episode of a policy.

    The order: ``robot, cloth, seed, policy`` (``scripted``, a name that needs no training, or the path of a model),
    ``with`` (names of layflat.policy.registry.DECORATORS), ``descriptor, noise, step_s, speed, hurry`` (as fast as it
    goes
    until the cloth is placed), ``record`` (a session's path, or empty), ``images`` and ``source`` (the device of a
    person who may take over, or empty).
    """

    def __init__(self, order: Request, desk: Endpoint) -> None:
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
        self._running: EpisodeWriter | None = None
        self._settle = 0
        self._phase_steps = 0
        self._repeats = 0
        self._pulled = 0
        self._last = {"input_s": 0.0, "work_s": 0.0}
        self._cadence = self._paced()
        self.bench = ClothSimulation(settings)
        self.bench.reset(int(order["seed"]))
        made = None if model is not None or order["policy"] == SCRIPTED else str(order["policy"])
        spec = PolicySpec(
            model=model,
            builtin=made or (None if model is not None else SCRIPTED),
            wrappers=tuple(order.get("with", ())),
        )
        begin = None if self._recorder is None else self._begin
        policy, source = spec.make(self.bench), str(order.get("source", ""))
        self._person = InterventionController(policy, source) if source else None
        self._name, self._extra_steps = policy.name, max_extra_steps(policy)
        self._decides: State = "placing"
        self._without_device = False
        self.run = EpisodeRunner(
            self.bench,
            policy if self._person is None else self._person.policy,
            seed=int(order["seed"]),
            keep_images=bool(order.get("images")),
            on_start=begin,
        )
        self._tell()

    def _begin(self, beginning: Episode) -> EpisodeWriter:
        assert self._recorder is not None
        self._running = self._recorder.start(beginning)
        return self._running

    def obey(self, order: Request) -> None:
        """``start``, ``pause``, ``disturb`` (with a ``name``), ``keep``, ``discard``, ``control`` (by its ``name``)."""
        do = order["do"]
        if do == "start" and self.state == "ready":
            self._turn("placing")
        elif do in ("pause", "start"):
            if self._without_device:
                self.message = f"{self._name} goes on alone"
            self.paused, self._without_device = do == "pause" and not self.paused, False
        elif do == "disturb" and self.state not in ("ready", "over"):
            self._disturb(str(order["name"]))
        elif do == "keep":
            self._keep()
        elif do == "discard":
            self._discard()
        elif do == "control":
            self._press(Command[str(order["name"])])

    def _press(self, control: Command) -> None:
        """A button of the person's device."""
        if self.does(control) is None:
            unrecorded = self._recorder is None and control in (*OUTCOMES, Command.DISCARD)
            self.message = NOT_RECORDED if unrecorded else f"there is nothing to {control.value} now"
        elif control is Command.START and not self.paused and self._person is not None:
            self._person.hand_back()
        elif control in (Command.START, Command.PAUSE):
            self.obey({"do": "pause"})
        elif control in OUTCOMES:
            self._keep(OUTCOMES[control])
        elif control is Command.DISCARD:
            self._discard()
        elif control is Command.DISTURB:
            self._disturb(DISTURBANCE)
        else:
            self.over = True

    def does(self, control: Command) -> str | None:
        """What a button of the person's device would do now, for a person; None where it would do nothing."""
        if control is Command.QUIT:
            return "end, to the menu"
        if control is Command.START:
            return "go on" if self.paused else f"hand back to {self._name}" if self._leads() == YOU else None
        if control is Command.PAUSE:
            return "go on" if self.paused else "pause"
        if control is Command.DISTURB:
            return None if self.state in ("ready", "over") else f"disturb the cloth ({DISTURBANCE})"
        if control is Command.REDO or self._running is None or not self.run.n_steps:
            return None
        if control is Command.DISCARD:
            return "forget this one"
        unstable = self._stopped_by == "unstable" and control is Command.KEEP_SUCCESS
        return None if unstable else f"keep as {OUTCOMES[control]}"

    def _leads(self) -> str:
        """Who decides, where a person may; empty where nobody does."""
        if self._person is None or self.paused or self.state not in ("placing", "repairing"):
            return ""
        return YOU if self._person.leads else self._name

    def _look(self) -> InputSample | None:
        """What the window put in last."""
        letter = self._desk.letter()
        if letter is not None and self._person is not None:
            self._hear(self._person, letter.reading)
        return letter

    def _hear(self, person: InterventionController, reading: TeleopInput) -> None:
        """Without its device time stands, as in a recording; it goes on with the device, or when one says so."""
        change = person.hear(reading)
        if change == "gone" and not self.paused:
            self.paused = self._without_device = True
            self.message = f"paused: {reading.problem}"
        elif change == "back" and self._without_device:
            self.paused = self._without_device = False
            self.message = f"{reading.device} is back; {self._name} goes on, move to take over"

    def _wake(self, pull: DragTarget | None) -> None:
        """What lies is moved again: by hands that take the lead, or by a pull at the cloth."""
        if self._person is not None and self._person.reading.moving and self.state in ("placed", "disturbing"):
            self._stopped_by = "interrupted"
            self._turn(self._decides)
        elif self.state == "placed" and pull is not None:
            self._turn("disturbing")
            self.message = "a hand pulls at the cloth"

    def advance(self) -> float:
        letter = self._look()
        if not self.paused:
            self._wake(None if letter is None else letter.pull)
        if self.paused or self.state not in PHASES:
            self._cadence.pause()
            return IDLE_S
        left_s = self._cadence.left_s()
        if left_s > 0:
            return left_s
        self._cadence.begin()
        began = time.monotonic()
        # Looked at again: what came while the step was waited for counts already.
        letter, led = self._look(), self._leads()
        pull = None if letter is None else letter.pull
        stop = self._step(pull)
        self._last = {"input_s": 0.0 if letter is None else letter.stamp_s, "work_s": time.monotonic() - began}
        self._cadence.end()
        self._tell()
        if self._person is not None and self._leads() != led:
            self.message = self._person.told()
        self._follow(stop, pull)
        return 0.0

    def _step(self, pull: DragTarget | None) -> StoppedBy | None:
        self._phase_steps += 1
        self._pulled += pull is not None
        limit = LIMIT_STEPS[self.state] + (0 if self.state == "disturbing" else self._extra_steps)
        if self._phase_steps > limit and self._leads() != YOU:
            return "step_limit"
        return self.run.step(PHASES[self.state], drag=pull)

    def _follow(self, stop: StoppedBy | None, pull: DragTarget | None) -> None:
        """What comes after a step."""
        if stop == "unstable":
            self._stopped_by, self.message = stop, "the cloth became unstable, which ends this episode"
            self._turn("over")
        elif self.state == "disturbing":
            self._settle = SETTLE_STEPS if pull is not None else self._settle - 1
            if stop is not None or (self._settle <= 0 and not self.run.disturbed):
                continue_after_disturbance(self.run.policy)
                self._turn("repairing")
                self.message = f"{self._name} goes on"
        elif stop is not None and pull is None and not self.run.disturbed:
            self._stopped_by = stop
            contact = 100 * self.run.observation.contact_portion
            more = "" if self._person is None else "; move to go on yourself"
            self.message = f"stopped by {stop.replace('_', ' ')}, contact {contact:.0f} %{more}"
            self._turn("placed")
        elif stop is not None:
            # It has stopped while something still moves the cloth: waited for, and then it goes on.
            self._turn("disturbing")

    def _turn(self, state: State) -> None:
        self.state, self._phase_steps, self._settle = state, 0, SETTLE_STEPS if state == "disturbing" else 0
        if state == "disturbing":
            self._decides = "repairing"
        if state == "placed" and self._order.get("hurry"):
            self._order = {**self._order, "hurry": False}
            self._cadence = self._paced()

    def _paced(self) -> RateLimiter:
        speed = 0.0 if self._order.get("hurry") else float(self._order["speed"])
        return RateLimiter(float(self._order["step_s"]), speed)

    def _disturb(self, name: str) -> None:
        self.run.disturb(name, self._repeats)
        self._repeats += 1
        self.message = f"{name}: begins now"
        if self.state in ("placed", "disturbing"):
            self._turn("disturbing")
            self._settle = 0

    def _keep(self, outcome: Outcome | None = None) -> None:
        """``outcome`` as the person judged, who also said that it is over; None: by how flat the cloth lies."""
        if self._running is None:
            self.message = NOT_RECORDED
            return
        judged = outcome is not None and self._stopped_by == "interrupted"
        episode = self.run.build_episode(JUDGED if judged else self._stopped_by, outcome)
        kept = self._running.save(episode)
        self._running, self.over = None, True
        self._turn("over")
        self._desk.tell("kept", line=kept_line(kept), outcome=kept.outcome)

    def _discard(self) -> None:
        if self._running is not None:
            self._running.discard()
            self._running = None
        self.over = True
        self._turn("over")
        self._desk.tell("discarded", line=f"discarded seed {self.run.seed}")

    def _tell(self) -> None:
        self._desk.channels.moments.tell(
            self.bench,
            self.run.observation,
            self.bench.ground_truth(),
            episode=1,
            step=self.run.n_steps,
            phase=PHASES.get(self.state, "place"),
            led=bool(self.run.steps) and self.run.steps[-1].intervention,
            **self._last,
        )

    def status(self) -> dict[str, Any]:
        rhythm = self._cadence.rhythm()
        return {
            "state": self.state,
            "paused": self.paused,
            "policy": self.run.policy.name,
            "leads": self._leads(),
            "led_steps": sum(step.intervention for step in self.run.steps),
            "does": {control.name: self.does(control) for control in Command} if self._person else {},
            "contact": self.run.observation.contact_portion,
            "seed": self.run.seed,
            "steps": self.run.n_steps,
            "message": self.message,
            "recording": self._recorder is not None,
            "pulled_steps": self._pulled,
            "disturbances": [record.name for record in self.run.disturbances],
            "rhythm": rhythm.told(),
            "factor": rhythm.factor(float(self._order["step_s"])),
            "flat_area": 0.0 if self.run.ground_truth is None else self.run.ground_truth.flat_area,
        }

    def close(self) -> None:
        """An episode that nobody has judged is kept as partial, where it is recorded at all."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            if self._running is not None and not self.run.n_steps:
                self._running.discard()
            recorder.close()
        self.bench.close()
