"""`layflat record --station`: demonstrations at a real robot, by hand, keys or pad."""

from __future__ import annotations

import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from layflat.app.commands.station import StationRun, run_on_station
from layflat.app.hardware.station_episode import PolicyMaker
from layflat.app.support.errors import UsageError, say
from layflat.app.support.session_lines import names_text
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workstation.session.session_queries import next_seeds
from layflat.app.workstation.teleop.registry import make_terminal_teleoperator
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleop_policy import TeleopPolicy
from layflat.app.workstation.teleop.teleoperator import Teleoperator
from layflat.data.types import Observation, StoppedBy
from layflat.policy.base import Decision, Policy
from layflat.policy.environment import Environment
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.robots.hanger import PandaHanger

GUIDED = "kinesthetic"
SOURCES = (GUIDED, "keyboard", "gamepad", SCRIPTED)
ENDS = (Command.KEEP_SUCCESS, Command.KEEP_FAILURE, Command.DISCARD, Command.REDO, Command.QUIT, Command.PAUSE)


def record_on_station(config: RecordConfig) -> None:
    """Record demonstrations on the station of ``config.station``; ``scripted`` only on its twin, which has a mesh."""
    if config.source not in SOURCES:
        raise UsageError(f"--source {config.source} is not for a station; use one of {', '.join(SOURCES)}")
    if config.robot != PandaHanger.spec.name:
        raise UsageError(f"a station's robot is {PandaHanger.spec.name}, not {config.robot}")
    if config.correct is not None:
        raise UsageError("--correct is for the simulation; leave it out at a station")
    seeds, skipped = next_seeds(config.path, config.source, config.episodes, config.seed)
    if skipped:
        say(f"{config.path} holds {names_text([str(seed) for seed in skipped])} already")
    with _person(config) as policy:
        run_on_station(
            StationRun(
                station=config.station or Path(),
                policy=policy,
                seeds=tuple(seeds),
                record=config.path,
                images=config.images,
                slow=config.slow,
                yes=config.yes,
            )
        )


@contextmanager
def _person(config: RecordConfig) -> Iterator[PolicyMaker]:
    """Return who demonstrates as a policy."""
    if config.source == SCRIPTED:
        yield PolicySpec(builtin=SCRIPTED)
        return
    if config.source == GUIDED:
        if not sys.stdin.isatty():
            raise UsageError("a person who guides the arm ends a demonstration with Enter; run this in a terminal")
        yield Person(GUIDED, GuidedPolicy())
        return
    teleoperator = make_terminal_teleoperator(config.source, PandaHanger.spec)
    try:
        yield Person(config.source, PersonPolicy(teleoperator))
    finally:
        teleoperator.close()


@dataclass(frozen=True)
class Person:
    """A demonstrator, as a station's episodes want it."""

    label: str
    policy: Policy

    def make(self, env: Environment) -> Policy:
        """Return the person."""
        return self.policy


class PersonPolicy(TeleopPolicy):
    """A person with keys or a pad; the buttons that keep, discard, pause or quit end the demonstration."""

    def __init__(self, teleoperator: Teleoperator) -> None:
        super().__init__(PandaHanger.spec, teleoperator.name, teleoperator.poll)
        self._teleoperator = teleoperator

    def act(self, observation: Observation) -> Decision:
        """Return the action of the newest input."""
        newest = self._teleoperator.poll()
        stop: StoppedBy | None = "converged" if any(command in ENDS for command in newest.commands) else None
        return Decision(action=newest.action, stop=stop, reason="moved by hand" if newest.moving else "held still")


class GuidedPolicy:
    """A person who moves the arm itself; Enter ends the demonstration."""

    name = GUIDED
    robot = PandaHanger.spec

    def reset(self, seed: int) -> None:
        """Say what to do."""
        say("guide the arm; press Enter when the cloth lies flat")

    def act(self, observation: Observation) -> Decision:
        """Yield to the hand, which is where the arm is."""
        done = bool(select.select([sys.stdin], [], [], 0)[0]) and sys.stdin.readline() is not None
        return Decision(
            action=self.robot.zeros(),
            hand=observation.holder_position,
            stop="converged" if done else None,
            reason="guided by hand",
        )
