"""SessionStatus: everything that a window, a terminal or a browser shows of a session, as one value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from layflat.app.workstation.teleop.teleop_input import Command
from layflat.data.environment_spec import StepLimits
from layflat.data.types import Outcome, Phase, StoppedBy

Mode: TypeAlias = Literal["record", "place", "correct"]
"""record: a person demonstrates. place: a policy places. correct: a policy places, and the person may take over."""
State: TypeAlias = Literal[
    "starting", "waiting", "countdown", "still", "running", "paused", "stopped", "finished", "asking", "over"
]
"""starting: no status has come yet. waiting: for START; the cloth hangs, or is being hung. countdown: about to run.
still: simulated time stands until the person moves. running: steps are simulated. paused: by the person, or because the
device is disconnected. stopped: the policy has stopped; time stands until the person moves, pulls or disturbs.
finished: no further step is possible (step limit, divergence) and only the label is missing. asking: the question is to
be answered. over: nothing more happens."""
Level: TypeAlias = Literal["info", "success", "warning", "error"]

YOU = "you"
"""Controller in a status: the person, or else the policy by its name."""
LEVELS: dict[Outcome, Level] = {"success": "success", "failure": "info", "partial": "warning"}
COUNTED = ("success", "failure", "partial", "discarded")


@dataclass(frozen=True, kw_only=True)
class Message:
    """A sentence for the person."""

    text: str = ""
    level: Level = "info"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Judgement of a take by how the cloth lies."""

    contact: float
    """Contact portion by the camera, 0..1."""
    flat_area: float
    """Signed area by the mesh over the cloth's area."""
    success: bool
    """Whether the task counts it as a success."""
    words: str
    """Such as "77 %, folded over at the free edge"."""


@dataclass(frozen=True, kw_only=True)
class SessionEvent:
    """Something that must be shown once: a take that is durable, or one that is gone for good."""

    kind: Literal["kept", "discarded", "note"]
    text: str
    """Line for scripts and people: "kept demo_3 success 84 steps contact 0.97 demos.h5"."""
    level: Level = "info"


@dataclass(frozen=True, kw_only=True)
class EpisodeStatus:
    """State of an episode after a step."""

    steps: int = 0
    time_s: float = 0.0
    """Simulated time."""
    contact: float = 0.0
    flat_area: float = 0.0
    verdict: Verdict | None = None
    """Judgement; of a session, once its take has stopped, or of the last one while the next one waits."""
    stopped_by: StoppedBy | None = None
    """Why no step was taken: the policy's reason, or divergence; None where one was."""
    disturbed: bool = False
    """Whether a disturbance acts, or the cloth has not come to rest after it."""
    human_in_control: bool = False
    intervention_steps: int = 0
    """Steps in which a person took over."""
    disturbances: tuple[str, ...] = ()
    policy: str = ""
    """Name of the policy; empty where a person demonstrates."""
    limits: StepLimits = field(default_factory=StepLimits)
    """Most steps of the policy in each phase."""


@dataclass(frozen=True, kw_only=True)
class SessionStatus(EpisodeStatus):
    """State of a session at one moment, with that of its current take."""

    mode: Mode = "record"
    task: str = "place"
    state: State = "starting"
    phase: Phase = "place"
    """Phase of the current or last step; disturb: the policy waits for the cloth to settle."""
    ready: bool = False
    """Whether the cloth hangs."""
    countdown_s: float = 0.0
    """Time until it runs; 0 in any other state than countdown."""
    file: str = ""
    """Session that is recorded into; empty where takes cannot be kept."""
    seed: int = 0
    """Seed of the current take."""
    source: str = ""
    """Teleoperator of the person; empty where there is none."""
    problem: str = ""
    """Why the teleoperator is disconnected, or empty."""
    controller: str = ""
    """Controller of the next step: `YOU`, or the policy's name; empty while neither decides."""
    drag_steps: int = 0
    dragging: bool = False
    """Whether the person pulls at the cloth now."""
    effects: Mapping[str, str] = field(default_factory=dict)
    """What each command would do now, by its name; one that would do nothing is missing."""
    disturbance: str = "none"
    """Disturbance that the command DISTURB starts."""
    can_disturb: bool = False
    """Whether a disturbance by name would act now."""
    can_drag: bool = False
    """Whether the cloth can be pulled now."""
    counts: Mapping[str, int] = field(default_factory=lambda: dict.fromkeys(COUNTED, 0))
    """Number of takes of this session by outcome, and of discarded ones."""
    n_episodes: int = 0
    """Number of episodes in the file."""
    target: int | None = None
    """Number of takes to keep as success or failure; None: until the person quits."""
    pace_s: float | None = None
    """Mean wall time for each kept take; None before the first."""
    message: Message = field(default_factory=Message)
    """The present state, or what has just happened."""
    asked: Outcome | None = None
    """Label that the question is about."""
    question: str = ""
    """Question that must be answered, such as "77 %, folded over: keep as success?"; empty in other states."""
    discarded: tuple[int, int] | None = None
    """Seed and steps of the take that UNDO would bring back."""
    timing: str = ""
    """How steadily the steps come, one line."""
    real_time_factor: float = 0.0
    """Simulated over wall time of the last steps; 0 where nothing was measured."""

    @property
    def recording(self) -> bool:
        """Whether takes can be kept."""
        return bool(self.file)

    def effect(self, command: Command) -> str | None:
        """Return what a command would do now, or None where it would do nothing."""
        return self.effects.get(command.name)

    @property
    def progress(self) -> str:
        """Target and pace: "12 of 20, 41 s each"."""
        n_kept = self.counts["success"] + self.counts["failure"]
        of = "" if self.target is None else f" of {self.target}"
        return f"{n_kept}{of}" + ("" if self.pace_s is None else f", {self.pace_s:.0f} s each")
