"""Session: the state machine of everything that a person and a policy do with one cloth after another.

It knows no device, no window and no simulator: inputs come by `handle_input` and `handle_command`, episodes run behind
`EpisodeHandle`, and nothing here waits.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from layflat.app.support.session_lines import copy_note
from layflat.app.workstation.session.effects import NOTE_S, OUTCOMES, describe, effects, nothing_to, summary
from layflat.app.workstation.session.episode import EpisodeLost, HandleFactory
from layflat.app.workstation.session.ledger import Ledger
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import LEVELS, Level, Message, SessionEvent, SessionStatus, State, Verdict
from layflat.app.workstation.session.take import Take
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Outcome

IDLE_S = 0.005
"""Time between two looks at the input while time stands."""


class Session:
    """Takes of one seed after another: `handle_...` what the person does, and `update` again and again until `done`."""

    def __init__(
        self, request: SessionRequest, make_episode: HandleFactory, *, seed: int = 0, used_seeds: Collection[int] = (),
        n_episodes: int = 0, recovered: Sequence[SavedEpisode] = (),
        emit: Callable[[SessionEvent], None] = lambda event: None, clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """Start with the cloth of the first seed being hung.

        Seeds go up from ``seed``, without ``used_seeds``. The file has ``n_episodes``, of which an interrupted session
        had left ``recovered`` running. ``emit`` is called with what must be shown once.
        """
        self._request, self._make_episode, self._clock = request, make_episode, clock
        self._used_seeds, self._seed, self._over = frozenset(used_seeds), seed, False
        self._countdown_end_s = 0.0
        self._ledger = Ledger(request, n_episodes, emit, clock)
        self._teleop = zero_input(request.sim_config.robot_spec)
        self._drag: DragTarget | None = None
        self._held: Take | None = None
        """The discarded take that UNDO brings back as it was; its process stands until the next take begins."""
        self._lost_in: State | None = None
        """State in which the device was disconnected."""
        self._verdict: Verdict | None = None
        """Judgement of the last take."""
        self._note: tuple[Message, State, int, float] = Message(), "over", 0, 0.0
        """What has just happened, in which state and with which seed, and until when it is said."""
        self._take: Take | None = None
        self._limiter = self._paced(request.speed)
        self._prepare(seed)
        for saved in recovered:
            self._ledger.note_saved(saved, counts=False)
            text = f"an earlier recording was interrupted; its steps are {saved.name}, {saved.outcome}"
            self._say(text, "warning", stays=True)
        if request.note.text:
            self._say(request.note.text, request.note.level, stays=True)

    def handle_input(self, teleop: TeleopInput, drag: DragTarget | None = None) -> None:
        """Take the newest input: pause where the device is disconnected, continue when it is back."""
        if not self._request.source:
            teleop = zero_input(self._request.sim_config.robot_spec)
        self._teleop, self._drag = teleop.without_commands(), drag
        if not teleop.connected and self._lost_in is None and self.state in ("countdown", "still", "running"):
            self._lost_in = self.state
            if self._take is not None:
                self._take.state = "paused"
        elif teleop.connected and self._lost_in is not None:
            before, self._lost_in = self._lost_in, None
            if self.state == "paused" and before != "paused":
                self._continue(before)
            self._say("")
            self._say(f"{teleop.device or 'the device'} is connected again; {self.status().message.text}")

    def handle_command(self, command: Command) -> None:
        """Carry out a command; one without an effect changes only the message."""
        take, at = self._take, self.status()
        if at.effect(command) is None:
            self._say(nothing_to(command, at), "warning")
        elif command is Command.QUIT:
            self.close()
        elif command is Command.UNDO:
            self._undo()
        elif command is Command.DISTURB:
            self.disturb(self._request.disturbance)
        elif take is None:
            return
        elif command in OUTCOMES:
            self._keep(take, OUTCOMES[command])
        elif command in (Command.DISCARD, Command.REDO):
            self._discard(take, again=command is Command.REDO)
        elif take.state == "countdown":
            take.state = "waiting"
        elif take.state in ("waiting", "paused"):
            self._continue("countdown" if take.state == "waiting" else "paused")
        elif command is Command.START and take.state == "running":
            take.handle.ask("release_control")
        else:
            take.pause()
            self._lost_in = None if self._lost_in is None else "paused"

    def disturb(self, name: str) -> None:
        """Start a named disturbance, where one can act now."""
        if self._take is not None and self._take.can_disturb:
            self._take.disturb(name)
            self._say(f"disturbance: {name}")
        else:
            self._say("there is nothing to disturb now", "warning")

    def answer(self, yes: bool) -> None:
        """Answer the question of the status: keep the take with the label after all, or go back to it."""
        if self._take is None or self._take.asked is None:
            self._say("there is no question to answer now", "warning")
        elif yes:
            self._keep(self._take, self._take.asked)
        else:
            self._take.pause()

    def close(self) -> None:
        """End the session; a take that has steps is kept as partial. May be called twice."""
        take, self._take, self._over = self._take, None, True
        self._release_held()
        if take is not None and self._request.session is not None and take.status.steps:
            self._ledger.save(take, "partial", "interrupted")
        elif take is not None:
            take.handle.discard()

    @property
    def state(self) -> State:
        """State of the session."""
        return "over" if self._over else "waiting" if self._take is None else self._take.state

    @property
    def done(self) -> bool:
        """Whether the session is over and everything is durable."""
        return self._over and not self._ledger.saving

    def update(self) -> float:
        """Do what is due; return for how many seconds nothing will be, unless something is done or comes in."""
        self._note_kept()
        if self._held is not None:
            with contextlib.suppress(EpisodeLost):  # It is noticed when the take is brought back.
                self._held.handle.poll()
        take = self._take
        if take is None or self._over:
            return IDLE_S
        try:
            if take.handle.poll():
                self._limiter.end_step()
                take.follow()
        except EpisodeLost as lost:
            self._handle_loss(take, lost)
            return 0.0
        if take.state == "countdown" and take.ready and self._clock() >= self._countdown_end_s:
            self._ledger.note_start()
            take.proceed()
        if not take.moves(self._teleop, self._drag):
            self._limiter.pause()
            if take.state == "stopped" and self._request.fast_forward:
                self._limiter = self._paced(self._request.speed)
            return IDLE_S
        if take.handle.busy:
            return IDLE_S
        if self._limiter.remaining_s() == 0:
            self._limiter.start_step()
            if take.step(self._teleop, self._drag):
                self._release_held()
        return self._limiter.remaining_s()

    def _handle_loss(self, take: Take, lost: EpisodeLost) -> None:
        """Save the steps of an episode whose simulation died, and prepare the same seed again."""
        if not take.ready:
            raise lost  # No cloth can be hung at all.
        self._take = None
        saved = take.handle.recover()
        if saved is not None:
            self._ledger.note_saved(saved)
        self._prepare(take.seed, starts=False)
        self._say(f"{lost}; its steps are kept as partial" if saved else str(lost), "error", stays=True)

    def _note_kept(self) -> None:
        for saved in self._ledger.poll():
            words = "" if self._verdict is None or saved.outcome == "partial" else f" ({self._verdict.words})"
            text = f"kept {saved.name} as {saved.outcome}{words}{summary(self._ledger.n_episodes, str(saved.path))}"
            self._say(text, LEVELS[saved.outcome], stays=True)
            if saved.copy_of is not None:
                self._say(copy_note(saved), "warning", stays=True)
        if self._take is None and not self._over and not self._ledger.saving:
            # As many as were asked for are durable; one that was lost meanwhile is done again.
            self._over = self._ledger.enough
            if not self._over:
                self._prepare(self._seed)

    def _paced(self, speed: float) -> RateLimiter:
        return RateLimiter(self._request.sim_config.step_s, speed, clock=self._clock)

    def _prepare(self, seed: int, *, starts: bool = True) -> None:
        """Start the next episode; its cloth is hung while the person decides."""
        while seed in self._used_seeds:
            seed += 1
        self._seed, self._lost_in = seed, None
        if self._request.fast_forward:
            self._limiter = self._paced(0.0)
        self._take = Take(handle=self._make_episode(seed), has_policy=self._request.policy is not None)
        if starts and self._request.mode == "place" and self._held is None:
            self._take.state = "countdown"  # which has ended: a policy needs no time to get ready

    def _continue(self, before: State) -> None:
        if self._take is not None and before == "countdown":
            self._take.state, self._countdown_end_s = "countdown", self._clock() + self._request.countdown_s
        elif self._take is not None:
            self._take.proceed()

    def _keep(self, take: Take, outcome: Outcome) -> None:
        """Keep the take with a label, or ask where the verdict does not agree with it."""
        verdict = take.status.verdict
        if take.asked != outcome and verdict is not None and verdict.success != (outcome == "success"):
            take.ask(outcome)
            return
        self._take, self._verdict, self._seed = None, verdict, take.seed + 1
        self._ledger.save(take, outcome, take.stopped_by or "converged")
        if not self._ledger.enough:
            self._prepare(self._seed)
        self._say(f"saving seed {take.seed} as {outcome}")

    def _discard(self, take: Take, *, again: bool) -> None:
        """Discard the take; one that has steps is held until the next one begins."""
        text, n_steps = "", take.status.steps
        if self._request.session is not None and n_steps:
            self._release_held()
            take.pause()
            self._held, self._verdict = take, take.status.verdict
            self._ledger.counts["discarded"] += 1
            text = f"discarded seed {take.seed}, {n_steps} steps; undo brings it back until the next one begins"
        else:
            take.handle.discard()
        self._prepare(take.seed if again else take.seed + 1)
        if again:
            self._continue("countdown")
        self._say(text, stays=True)

    def _undo(self) -> None:
        """Bring the discarded take back; the one that was prepared instead has no steps yet."""
        if self._held is None:
            return
        if self._take is not None:
            self._take.handle.discard()
        self._take, self._held, self._lost_in = self._held, None, None
        self._seed = self._take.seed
        self._ledger.counts["discarded"] -= 1
        self._take.handle.ask("show")
        self._say(f"seed {self._seed} is back with its {self._take.status.steps} steps", "success")

    def _release_held(self) -> None:
        """Discard the held take for good: the next one begins, or the session ends."""
        held, self._held = self._held, None
        if held is not None:
            held.handle.discard()
            self._ledger.note_discarded(held)

    def _say(self, text: str, level: Level = "info", *, stays: bool = False) -> None:
        until_s = math.inf if stays else self._clock() + NOTE_S
        self._note = Message(text=text, level=level), self.state, self._seed, until_s

    def status(self) -> SessionStatus:
        """Return the state, as it is shown."""
        take = self._take
        shown = replace(
            self._request.first_status(),
            state=self.state,
            seed=self._seed,
            problem="" if self._teleop.connected else self._teleop.problem,
            counts=dict(self._ledger.counts),
            n_episodes=self._ledger.n_episodes,
            pace_s=self._ledger.pace_s,
            verdict=self._verdict if self.state in ("waiting", "countdown", "over") else None,
            timing=self._limiter.describe(),
            real_time_factor=self._limiter.real_time_factor,
        )
        if take is not None:
            shown = take.show_in(shown, dragging=self._drag is not None)
            left_s = max(self._countdown_end_s - self._clock(), 0.0) if take.state == "countdown" else 0.0
            shown = replace(shown, countdown_s=left_s)
            if self._held is not None and not take.status.steps:
                shown = replace(shown, discarded=(self._held.seed, self._held.status.steps))
        message, state, seed, until_s = self._note
        if not message.text or (state, seed) != (shown.state, shown.seed) or self._clock() >= until_s:
            message = describe(shown)
        return replace(shown, message=message, effects=effects(shown))
