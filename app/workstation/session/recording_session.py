"""RecordingSession: the state machine of a recording by a person.

It knows no device, no window and no simulator: inputs come by `handle_input`, episodes run behind `EpisodeHandle`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

from layflat.app.support.session_lines import discarded_line, kept_line
from layflat.app.workstation.session.command_effects import ACTIVE, OUTCOMES, SessionState, command_effect
from layflat.app.workstation.session.episode_handle import EpisodeHandle, EpisodeLost, EpisodeStatus, HandleFactory
from layflat.app.workstation.session.intervention import describe_control
from layflat.app.workstation.session.session_queries import n_episodes, skipped_text
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Outcome, StoppedBy

COUNTDOWN_S = 3.0
MAX_STEPS = 600
"""A minute of motion: several times what placing takes."""
ENDED_BY_PERSON: StoppedBy = "converged"
"""Reason of an episode that the person ended by their verdict."""
POLICY = "the policy"


class RecordingSession:
    """Demonstrations of consecutive seeds, recorded into one session file.

    >>> while recording.state != "over":
    ...     recording.handle_input(teleoperator.poll())
    ...     if not recording.step():
    ...         time.sleep(0.01)
    """

    def __init__(
        self,
        recorder: SessionRecorder,
        make_episode: HandleFactory,
        *,
        seed: int = 0,
        used_seeds: Collection[int] = (),
        episodes: int | None = None,
        disturbance: str = "none",
        countdown_s: float = COUNTDOWN_S,
        max_steps: int = MAX_STEPS,
        policy_in_control: bool = False,
        print_line: Callable[[str], None] = print,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start with the cloth of the first seed being hung.

        Parameters
        ----------
        seed, used_seeds
            Seeds go up from ``seed``, without ``used_seeds``.
        episodes
            The recording is over when so many are kept as success or failure; None: with QUIT.
        disturbance
            Disturbance that DISTURB starts.
        policy_in_control
            Whether a policy is in control until the person moves, so that time does not wait for the first motion.
        print_line
            Called with each line about a kept or discarded episode, once it is durable.
        """
        self._make_episode = make_episode
        self._used_seeds = frozenset(used_seeds)
        self._episodes = episodes
        self._disturbance = disturbance
        self._countdown_s = countdown_s
        self._max_steps = max_steps
        self._policy_in_control = policy_in_control
        self._print_line = print_line
        self._clock = clock
        self._path = recorder.path
        self.n_episodes = n_episodes(recorder.path)
        """Number of episodes in the session."""
        self._teleop: TeleopInput | None = None
        self._disconnected_in: SessionState | None = None
        """State in which the device was disconnected."""
        self._at_rest = True
        self._countdown_start_s = 0.0
        self.counts: dict[str, int] = {"success": 0, "failure": 0, "partial": 0, "discarded": 0}
        """Number of demonstrations of this recording by their outcome."""
        self.message = ""
        """Newest sentence for the person."""
        self.seed = seed
        """Seed of the current demonstration."""
        self.state: SessionState = "waiting"
        self.status = EpisodeStatus()
        """Status of the current demonstration."""
        self._episode: EpisodeHandle | None = None
        for saved in recorder.recovered:
            self._print_line(kept_line(saved))
            self.message = f"an earlier recording was interrupted; its steps are {saved.name}, {saved.outcome}"
        self._prepare(seed)
        skipped = [used for used in self._used_seeds if seed <= used < self.seed]
        if skipped and not self.message:
            self.message = skipped_text(self._path, skipped, [self.seed])

    @property
    def ready(self) -> bool:
        """Whether the cloth hangs."""
        return self._episode is not None and self._episode.ready()

    @property
    def is_stepping(self) -> bool:
        """Whether the next `step` will simulate one, if the cloth is not dragged."""
        return self.state == "running" and not (self._at_rest and (self._teleop is None or not self._teleop.moving))

    @property
    def waiting_for_motion(self) -> bool:
        """Whether it runs, but simulated time waits for the first motion."""
        return self.state == "running" and self._at_rest

    def handle_input(self, teleop: TeleopInput) -> None:
        """Take a new input: handle its commands, pause where the device is disconnected, continue when it is back."""
        self._teleop = teleop.without_commands()
        if not teleop.connected:
            self._handle_disconnect(teleop)
        elif self._disconnected_in is not None:
            self._handle_reconnect(teleop)
        for command in teleop.commands:
            self.handle_command(command)

    def effect(self, command: Command) -> str | None:
        """Return what a command would do now, or None where it would do nothing."""
        return command_effect(command, self.state, self.status, seed=self.seed, disturbance=self._disturbance)

    def handle_command(self, command: Command) -> None:
        """Carry out a command; one without an effect changes only the message."""
        if self.effect(command) is None:
            self.message = f"nothing to {command.value} now"
            return
        if command is Command.QUIT:
            self.close()
        elif command in OUTCOMES:
            self._save(OUTCOMES[command])
        elif command is Command.DISTURB:
            self._disturb()
        elif command in (Command.DISCARD, Command.REDO):
            self._discard()
            self._prepare(self.seed if command is Command.REDO else self.seed + 1)
            if command is Command.REDO:
                self._start_countdown()
        elif self.state == "waiting":
            self._start_countdown()
        elif self.state == "countdown":
            self.state, self.message = "waiting", "countdown stopped"
        elif command is Command.START and self.state == "running":
            self._release_control()
        elif self.state == "running":
            self.state = self.message = "paused"
        else:
            self._run()

    def step(self, drag: DragTarget | None = None) -> bool:
        """Advance by what the state asks for; return whether a step was simulated. Wait only for the simulation.

        ``drag`` is where the mouse drags the cloth. EpisodeLost where no cloth can be hung at all.
        """
        if self.state in ("waiting", "countdown"):
            if self.ready and self._episode is not None:
                self.status = self._episode.status()
                if self.state == "countdown" and self.countdown_left_s() == 0:
                    self._run()
            return False
        if self.state != "running" or self._episode is None or self._teleop is None:
            return False
        if self._at_rest and not self._teleop.moving and drag is None:
            return False
        if self._at_rest and self._policy_in_control:
            self.message = describe_control(True, POLICY)
        self._at_rest, before = False, self.status.human_in_control
        try:
            self.status = self._episode.step(self._teleop, drag)
        except EpisodeLost as lost:
            self._handle_loss(lost)
            return False
        if self.status.human_in_control != before:
            self.message = describe_control(self.status.human_in_control, POLICY)
        self._check_end()
        return True

    def countdown_left_s(self) -> float:
        """Return the seconds until it runs; 0 in any other state."""
        if self.state != "countdown":
            return 0.0
        return max(self._countdown_start_s + self._countdown_s - self._clock(), 0.0)

    def close(self) -> None:
        """End the recording; a running demonstration is kept as partial. May be called twice."""
        episode, self._episode = self._episode, None
        before, self.state = self.state, "over"
        if episode is None:
            return
        if before in ACTIVE and self.status.n_steps:
            self._note_saved(episode.save("partial", "interrupted"))
        else:
            episode.discard()
            self.message = f"the recording has ended; {self._summary()}"

    def _prepare(self, seed: int) -> None:
        """Start the next episode; its cloth is hung while the person decides."""
        while seed in self._used_seeds:
            seed += 1
        self.seed = seed
        self.status = EpisodeStatus()
        self._disconnected_in = None
        self._episode = self._make_episode(seed)
        self.state = "waiting"

    def _start_countdown(self) -> None:
        self.state = "countdown"
        self._countdown_start_s = self._clock()
        self.message = f"seed {self.seed}: get ready"

    def _run(self) -> None:
        self.state = "running"
        self._at_rest = not self._policy_in_control
        self.message = "the policy places; move to take over" if self._policy_in_control else "starts when you move"

    def _handle_disconnect(self, teleop: TeleopInput) -> None:
        if self.state in ("running", "countdown"):
            self._disconnected_in = self.state
            self.state, self.message = "paused", f"paused: {teleop.problem}"
        elif self._disconnected_in is None:
            self.message = teleop.problem

    def _handle_reconnect(self, teleop: TeleopInput) -> None:
        before, self._disconnected_in = self._disconnected_in, None
        if self.state != "paused":
            return
        if before == "countdown":
            self._start_countdown()
        else:
            self._run()
        self.message = f"{teleop.device or 'the device'} is connected again; {self.message}"

    def _disturb(self) -> None:
        if self._episode is None:
            return
        try:
            self._episode.disturb(self._disturbance)
            self.status = self._episode.status()
            self.message = f"disturbance: {self._disturbance}"
        except EpisodeLost as lost:
            self._handle_loss(lost)

    def _release_control(self) -> None:
        if self._episode is None:
            return
        try:
            self._episode.release_control()
        except EpisodeLost as lost:
            self._handle_loss(lost)

    def _check_end(self) -> None:
        if self.status.stopped_by == "unstable":
            self.state = "finished"
            self.message = "the simulation diverged; keep it as failure, discard it, or redo it"
        elif self.status.stopped_by is not None:
            self._at_rest = True
            self.message = f"the policy has stopped ({self.status.stopped_by}); move to continue yourself, or keep it"
        elif self.status.n_steps >= self._max_steps:
            self.state = "finished"
            self.message = f"the limit of {self._max_steps} steps is reached; keep it or discard it"

    def _save(self, outcome: Outcome) -> None:
        episode, self._episode = self._episode, None
        if episode is None:
            return
        limit: StoppedBy = "step_limit" if self.state == "finished" else ENDED_BY_PERSON
        self._note_saved(episode.save(outcome, self.status.stopped_by or limit))
        if self._episodes is not None and self.counts["success"] + self.counts["failure"] >= self._episodes:
            self.state = "over"
        else:
            self._prepare(self.seed + 1)

    def _discard(self) -> None:
        episode, self._episode = self._episode, None
        if episode is None:
            return
        episode.discard()
        if self.status.n_steps:
            self.counts["discarded"] += 1
            self._print_line(discarded_line(self.seed, self.status.n_steps, self.status.contact_portion, self._path))
        self.message = f"discarded seed {self.seed}; {self._summary()}"

    def _handle_loss(self, lost: EpisodeLost) -> None:
        """Save the steps of an episode whose simulation died, and prepare the same seed again."""
        episode, self._episode = self._episode, None
        saved = episode.save("partial", "crashed") if episode is not None else None
        self._note_saved(saved)
        self._prepare(self.seed)
        self.message = f"{lost}; " + ("its steps are kept as partial" if saved else "it had no steps")

    def _note_saved(self, saved: SavedEpisode | None) -> None:
        if saved is None:
            return
        self.counts[saved.outcome] += 1
        self.n_episodes += 1
        self._print_line(kept_line(saved))
        self.message = f"kept {saved.name} as {saved.outcome}; {self._summary()}"

    def _summary(self) -> str:
        return f"{self.n_episodes} {'demonstration' if self.n_episodes == 1 else 'demonstrations'} in {self._path}"
