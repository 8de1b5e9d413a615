"""SessionRequest: settings of one interactive session."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from layflat.app.workstation.session.status import Message, Mode, SessionStatus
from layflat.data.session.environment_recorder import recorder_for
from layflat.data.session.recorder import SessionRecorder
from layflat.policy.spec import PolicySpec
from layflat.sim.conditions.variation import NO_VARIATION, Variation
from layflat.sim.config import SimConfig

COUNTDOWN_S = 3.0


@dataclass(frozen=True, kw_only=True)
class SessionRequest:
    """Settings of one interactive session: what is done, by whom, and into which file."""

    sim_config: SimConfig
    """Robot, task, cloth, physics and conditions."""
    variation: Variation = NO_VARIATION
    """Conditions that each seed draws."""
    policy: PolicySpec | None = None
    """Policy that places; None: the person demonstrates."""
    source: str = ""
    """Teleoperator of the person, who may take over from the policy; empty where there is none."""
    session: Path | None = None
    """Session to record into; None: nothing is recorded."""
    seed: int | None = None
    """First seed; None: the first one that the session does not hold."""
    episodes: int | None = None
    """Number of takes to keep; None: until the person quits."""
    disturbance: str = "push"
    """Disturbance that the command DISTURB starts."""
    speed: float = 1.0
    """Simulated over wall time at most; 0 is as fast as possible."""
    fast_forward: bool = False
    """Whether a policy places as fast as possible; the speed counts once it has stopped."""
    images: bool = False
    """Whether camera images are saved."""
    countdown_s: float = COUNTDOWN_S
    """Time between START and the first step; a policy starts without one."""
    note: Message = field(default_factory=Message)
    """First message, such as which device is used instead of a missing one."""

    @property
    def mode(self) -> Mode:
        """Kind of session."""
        if self.policy is None:
            return "record"
        return "correct" if self.source else "place"

    @property
    def recorded_source(self) -> str:
        """Name by which the session knows who decided: the device, the policy, or both."""
        if self.policy is None:
            return self.source
        policy = replace(self.policy, label="").label
        return f"{policy}+{self.source}" if self.source else policy

    def first_status(self) -> SessionStatus:
        """Return the status before anything has happened."""
        return SessionStatus(
            mode=self.mode,
            task=self.sim_config.task,
            source=self.source,
            policy="" if self.policy is None else self.policy.label,
            disturbance=self.disturbance,
            file="" if self.session is None else str(self.session),
            seed=self.seed or 0,
            target=self.episodes,
            message=self.note if self.note.text else Message(text="starting"),
        )

    def open_recorder(self) -> SessionRecorder | None:
        """Open the session; DataError where it holds something else."""
        if self.session is None:
            return None
        self.session.parent.mkdir(parents=True, exist_ok=True)
        return recorder_for(self.session, self.sim_config.environment_spec(), save_images=self.images)
