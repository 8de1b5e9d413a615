"""Recording as a state machine: what the controls do, whoever has them, and what is said about it.

It knows no device, no window and no simulator: readings come in by ``hear``, episodes run behind the seam
``EpisodeHandle``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

from layflat.app.support.session_lines import discarded_line, kept_line
from layflat.app.workstation.session.control_actions import ACTIVE, OUTCOMES, VERBS, SessionState, control_action
from layflat.app.workstation.session.episode_handle import EpisodeHandle, EpisodeLost, EpisodeStatus, HandleFactory
from layflat.app.workstation.session.intervention import led_sentence
from layflat.app.workstation.session.session_queries import stored
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Outcome, StoppedBy

COUNTDOWN_S = 3.0
STEPS_MAX = 600
"""A minute of motion: several times what a placing takes."""
JUDGED: StoppedBy = "converged"
"""What an episode says when the person said that it was over."""


class RecordingSession:
    """Demonstrations of consecutive seeds into one session.

    >>> while recording.state != "over":
    ...     recording.hear(source.poll())
    ...     if not recording.step():
    ...         time.sleep(0.01)
    """

    def __init__(
        self,
        recorder: SessionRecorder,
        begin: HandleFactory,
        *,
        seed: int = 0,
        skip: Collection[int] = (),
        episodes: int | None = None,
        disturbance: str = "none",
        countdown_s: float = COUNTDOWN_S,
        steps_max: int = STEPS_MAX,
        led: bool = False,
        tell: Callable[[str], None] = print,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """``episodes``: over after so many have been kept as success or failure; None: until QUIT.

        Seeds go up from ``seed``, without those in ``skip``, which the session has already. ``tell`` gets the
        contract's lines (``kept demo_3 success 84 steps contact 0.97 FILE.h5``, ``discarded seed 4 ...``), each only
        when it is true. ``disturbance`` is what DISTURB begins. ``led``: a policy has the lead until the person's hands
        move, so that time waits for no motion before it has stopped.
        """
        self._begin = begin
        self._skip = frozenset(skip)
        self._episodes = episodes
        self._disturbance = disturbance
        self._countdown_s = countdown_s
        self._steps_max = steps_max
        self._led = led
        self._tell = tell
        self._clock = clock
        self._path = recorder.path
        self.stored = stored(recorder.path)
        """Episodes in the session."""
        self._reading: TeleopInput | None = None
        self._interrupted_by_device: SessionState | None = None
        self._still = True
        self._from_s = 0.0
        self.counts: dict[str, int] = {"success": 0, "failure": 0, "partial": 0, "discarded": 0}
        """What came of the demonstrations of this recording."""
        self.message = ""
        """The last thing that was said, one sentence for a person."""
        self.seed = seed
        """Of the demonstration that waits or runs."""
        self.state: SessionState = "waiting"
        self.glance = EpisodeStatus()
        """How it stands."""
        self._take: EpisodeHandle | None = None
        for kept in recorder.recovered:
            self._tell(kept_line(kept))
            self.message = f"an earlier recording was cut off; what there was of it is {kept.name}, {kept.outcome}"
        self._prepare(seed)

    @property
    def ready(self) -> bool:
        """Whether the cloth hangs."""
        return self._take is not None and self._take.ready()

    def hear(self, reading: TeleopInput) -> None:
        """Take note of a reading: obey its controls, pause where the device has gone, go on when it is back."""
        self._reading = reading.heard()
        if not reading.connected:
            self._without_device(reading)
        elif self._interrupted_by_device is not None:
            self._with_device_again()
        for control in reading.controls:
            self.handle(control)

    def handle(self, control: Command) -> None:
        """Obey one control; one that makes no sense now does nothing but say so."""
        if self.does(control) is None:
            self.message = f"there is nothing to {VERBS[control]} now"
            return
        if control is Command.QUIT:
            self.close()
        elif control in OUTCOMES:
            self._keep(OUTCOMES[control])
        elif control is Command.DISTURB:
            self._disturb()
        elif control in (Command.DISCARD, Command.REDO):
            self._discard()
            again = control is Command.REDO
            self._prepare(self.seed if again else self.seed + 1)
            if again:
                self._count_down()
        elif self.state == "waiting":
            self._count_down()
        elif self.state == "countdown":
            self._wait()
        elif control is Command.START and self.state == "running":
            self._hand_back()
        elif self.state == "running":
            self._pause("paused")
        else:
            self._run()

    def does(self, control: Command) -> str | None:
        """What the control would do now, for a person; None where it would do nothing."""
        return control_action(control, self.state, self.glance, seed=self.seed, disturbance=self._disturbance)

    def step(self, pull: DragTarget | None = None) -> bool:
        """One step of what the state asks; True where a step was simulated. Waits for nothing but the simulation.

        ``pull`` is what the mouse draws the cloth by. EpisodeLost where no cloth can be hung at all.
        """
        if self.state == "waiting" or self.state == "countdown":
            if self.ready and self._take is not None:
                self.glance = self._take.glance()
                if self.state == "countdown" and self.countdown_left_s() == 0:
                    self._run()
            return False
        if self.state != "running" or self._take is None or self._reading is None:
            return False
        if self._still and pull is None and not self._reading.moving:
            return False
        if self._still and self._led:
            self.message = led_sentence(True, "the policy")
        self._still, led = False, self.glance.led
        try:
            self.glance = self._take.step(self._reading, pull)
        except EpisodeLost as lost:
            self._lose(lost)
            return False
        if self.glance.led != led:
            self.message = led_sentence(self.glance.led, "the policy")
        self._look_for_the_end()
        return True

    def countdown_left_s(self) -> float:
        """Seconds until it runs; 0 in any other state."""
        if self.state != "countdown":
            return 0.0
        return max(self._from_s + self._countdown_s - self._clock(), 0.0)

    @property
    def simulates(self) -> bool:
        """Whether the next ``step`` will simulate one, if nothing is pulled at."""
        return self.state == "running" and not (self._still and (self._reading is None or not self._reading.moving))

    @property
    def awaits_motion(self) -> bool:
        """Whether it runs, but simulated time stands until the first motion."""
        return self.state == "running" and self._still

    def close(self) -> None:
        """End it now: a demonstration that runs is kept as partial. May be called twice; called by QUIT."""
        take, self._take = self._take, None
        was, self.state = self.state, "over"
        if take is None:
            return
        if was in ACTIVE and self.glance.n_steps:
            kept = take.keep("partial", "interrupted")
            if kept is not None:
                self._say_kept(kept)
        else:
            take.discard()
            self.message = f"the recording is over; {self._so_far()}"

    def _prepare(self, seed: int) -> None:
        """The next take; its cloth is hung while the person has a look at what to do."""
        while seed in self._skip:
            seed += 1
        self.seed = seed
        self.glance = EpisodeStatus()
        self._interrupted_by_device = None
        self._take = self._begin(seed)
        self.state = "waiting"

    def _wait(self) -> None:
        self.state = "waiting"
        self.message = "not begun"

    def _count_down(self) -> None:
        self.state = "countdown"
        self._from_s = self._clock()
        self.message = f"seed {self.seed}: get ready"

    def _run(self) -> None:
        self.state = "running"
        self._still = not self._led
        self.message = "the policy places; move to take over" if self._led else "runs with your first motion"

    def _pause(self, why: str) -> None:
        self.state = "paused"
        self.message = why

    def _without_device(self, reading: TeleopInput) -> None:
        if self.state in ("running", "countdown"):
            self._interrupted_by_device = self.state
            self._pause(f"paused: {reading.problem}")
        elif self._interrupted_by_device is None:
            self.message = reading.problem

    def _with_device_again(self) -> None:
        before, self._interrupted_by_device = self._interrupted_by_device, None
        if self.state != "paused":
            return
        device = self._reading.device if self._reading is not None else ""
        if before == "countdown":
            self._count_down()
        else:
            self._run()
        self.message = f"{device or 'the device'} is back; {self.message}"

    def _disturb(self) -> None:
        if self._take is None:
            return
        try:
            self._take.disturb(self._disturbance)
            self.glance = self._take.glance()
            self.message = f"disturbing: {self._disturbance}"
        except EpisodeLost as lost:
            self._lose(lost)

    def _hand_back(self) -> None:
        if self._take is None:
            return
        try:
            self._take.hand_back()
        except EpisodeLost as lost:
            self._lose(lost)

    def _look_for_the_end(self) -> None:
        if self.glance.stopped_by == "unstable":
            self._finish("the cloth came apart; keep it as failure, discard it, or do it again")
        elif self.glance.stopped_by is not None:
            self._still = True
            self.message = f"the policy has stopped ({self.glance.stopped_by}); move to go on yourself, or keep it"
        elif self.glance.n_steps >= self._steps_max:
            self._finish(f"{self._steps_max} steps are over; keep it or discard it")

    def _finish(self, why: str) -> None:
        self.state = "finished"
        self.message = why

    def _keep(self, outcome: Outcome) -> None:
        take, self._take = self._take, None
        if take is None:
            return
        kept = take.keep(outcome, self.glance.stopped_by or ("step_limit" if self.state == "finished" else JUDGED))
        if kept is not None:
            self._say_kept(kept)
        if self._episodes is not None and self.counts["success"] + self.counts["failure"] >= self._episodes:
            self.state = "over"
        else:
            self._prepare(self.seed + 1)

    def _discard(self) -> None:
        take, self._take = self._take, None
        if take is None:
            return
        take.discard()
        glance = self.glance
        if glance.n_steps:
            self.counts["discarded"] += 1
            self._tell(discarded_line(self.seed, glance.n_steps, glance.contact_portion, self._path))
        self.message = f"discarded seed {self.seed}; {self._so_far()}"

    def _lose(self, lost: EpisodeLost) -> None:
        """The simulation died: what there is of it is kept, and the same seed comes again."""
        take, self._take = self._take, None
        kept = take.keep("partial", "crashed") if take is not None else None
        if kept is not None:
            self._say_kept(kept)
        self._prepare(self.seed)
        self.message = f"{lost}; " + ("what there was is kept as partial" if kept else "nothing of it was left")

    def _say_kept(self, kept: SavedEpisode) -> None:
        self.counts[kept.outcome] += 1
        self.stored += 1
        self._tell(kept_line(kept))
        self.message = f"kept {kept.name} as {kept.outcome}; {self._so_far()}"

    def _so_far(self) -> str:
        return f"{self.stored} {'demonstration' if self.stored == 1 else 'demonstrations'} in {self._path}"
