"""SessionFacts: what a page has to know of a session file before it is used."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from layflat.data.session.parts import parts_folder
from layflat.data.session.reader import open_session
from layflat.sim.config import SimConfig


@dataclass(frozen=True, kw_only=True)
class SessionFacts:
    """Parts of the simulation and outcomes of a session."""

    robot: str
    task: str
    cloth: str
    physics: str
    descriptor: str
    step_s: float
    outcomes: tuple[str, ...]
    """Outcome of each episode."""

    def describe(self) -> str:
        """Return the facts in one line."""
        counts = {name: self.outcomes.count(name) for name in dict.fromkeys(self.outcomes)}
        listed = ", ".join(f"{count} {name}" for name, count in counts.items()) or "no episodes yet"
        return f"{self.robot}, {self.cloth}, task {self.task}: {listed}"

    def sim_config(self, *, noise: bool) -> SimConfig:
        """Return the simulation whose episodes fit into the session."""
        return SimConfig(
            robot=self.robot, task=self.task, cloth=self.cloth, physics=self.physics, descriptor=self.descriptor,
            step_s=self.step_s, noise=noise,
        )  # fmt: skip

    def fits(self, config: SimConfig) -> bool:
        """Return whether episodes of a simulation can be recorded into the session."""
        return self.sim_config(noise=config.noise) == config


def session_facts(path: Path) -> SessionFacts:
    """Return the facts of a session; DataError where it cannot be read."""
    places = (path, parts_folder(path.resolve()), path.with_name(f"{path.name}.edits.jsonl"))
    return _read(path, tuple(place.stat().st_mtime_ns if place.exists() else 0 for place in places))


@lru_cache(maxsize=64)
def _read(path: Path, _: tuple[int, ...]) -> SessionFacts:
    with open_session(path) as session:
        return SessionFacts(
            robot=session.robot.name,
            task=session.task,
            cloth=session.cloth,
            physics=session.physics,
            descriptor=session.descriptor,
            step_s=session.step_s,
            outcomes=tuple(info.outcome for info in session.infos().values()),
        )
