"""Folder: the files that the workstation shows, and the only ones that a page can name; and what is in a session."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from layflat.app.support.errors import UsageError
from layflat.data.names import storable
from layflat.data.session.parts import part_files, parts_folder
from layflat.data.session.reader import open_session
from layflat.policy.foreign.factory import GROUP
from layflat.sim.config import SimConfig

SESSION, MODEL = ".h5", ".npz"
_FOREIGN = re.compile(r"wss?://[^\s+]+|[\w.]+:[\w.]+")


@dataclass(frozen=True)
class Folder:
    """Folder that was opened; the newest files come first."""

    path: Path

    @property
    def read_only(self) -> bool:
        """Whether nothing can be written here."""
        return not os.access(self.path, os.W_OK)

    def sessions(self) -> list[str]:
        """Return the names of the session files, also of those whose episodes are still in parts."""
        parts = [path.name.removesuffix(".parts") for path in self.path.glob(f"*{SESSION}.parts") if path.is_dir()]
        started = [name for name in parts if not (self.path / name).exists() and part_files(self.path / name)]
        return [*started, *self._newest(f"*{SESSION}")]

    def models(self) -> list[str]:
        """Return the names of the model files."""
        return self._newest(f"*{MODEL}")

    def foreign(self) -> list[str]:
        """Return the names of files that may be data sets of other tools."""
        return self._newest("*.hdf5")

    def results(self) -> list[str]:
        """Return the names of the folders that an evaluation has written."""
        return self._newest("*", lambda path: (path / "episodes.csv").is_file())

    def session(self, name: str) -> Path:
        """Return the file of a session that is here; UsageError for any other name."""
        return self._known(name, self.sessions())

    def model(self, name: str) -> Path:
        """Return the file of a model that is here; UsageError for any other name."""
        return self._known(name, self.models())

    def result(self, name: str) -> Path:
        """Return the folder of an evaluation that is here; UsageError for any other name."""
        return self._known(name, self.results())

    def new(self, name: str, suffix: str = "") -> Path:
        """Return the place of a file to write, with its suffix; UsageError for a name that leads elsewhere."""
        name = name.strip()
        name = name if name.endswith(suffix) else f"{name}{suffix}"
        if name in (suffix, "") or name.startswith(".") or "\0" in name or Path(name).name != name:
            raise UsageError(f"{name!r} is not a name for a file here; give one without / and without a leading dot")
        if self.read_only:
            raise UsageError(f"{self.path} cannot be written; it can only be looked at")
        return self.path / name

    def _known(self, name: str, names: list[str]) -> Path:
        if name not in names:
            raise UsageError(f"{name or 'nothing'} is not in {self.path} any more; choose another one")
        return self.path / name

    def _newest(self, pattern: str, accept: Callable[[Path], bool] = Path.is_file) -> list[str]:
        dated = []
        for path in self.path.glob(pattern):
            try:
                if path.name == storable(path.name) and not path.name.startswith(".") and accept(path):
                    dated.append((path.stat().st_mtime, path.name))
            except OSError:
                continue  # It has just been removed.
        return [name for _, name in sorted(dated, reverse=True)]


def foreign_policy(text: str) -> str:
    """Return the text of a policy of the user's; UsageError where it is none, such as the path of a file."""
    first = text.strip().partition("+")[0]
    known = {point.name for point in metadata.entry_points(group=GROUP)}
    if first not in known and not _FOREIGN.fullmatch(first):
        raise UsageError(
            f"policy {text!r} is not package.module:factory, nor an entry-point name of {GROUP}, nor ws://HOST:PORT"
        )
    return text.strip()


@dataclass(frozen=True, kw_only=True)
class SessionFacts:
    """The simulation of a session's episodes, without noise, and the outcome of each."""

    config: SimConfig
    outcomes: tuple[str, ...]

    def describe(self) -> str:
        """Return the facts in one line."""
        counts = [f"{self.outcomes.count(name)} {name}" for name in dict.fromkeys(self.outcomes)]
        config, listed = self.config, ", ".join(counts) or "no episodes yet"
        return f"{config.robot}, {config.cloth}, task {config.task}: {listed}"


def session_facts(path: Path) -> SessionFacts:
    """Return the facts of a session; DataError where it cannot be read."""
    places = (path, parts_folder(path.resolve()), path.with_name(f"{path.name}.edits.jsonl"))
    return _read(path, tuple(place.stat().st_mtime_ns if place.exists() else 0 for place in places))


@lru_cache(maxsize=64)
def _read(path: Path, _: tuple[int, ...]) -> SessionFacts:
    with open_session(path) as session:
        parts = {name: getattr(session, name) for name in ("task", "cloth", "physics", "descriptor", "step_s")}
        config = SimConfig(robot=session.robot.name, noise=False, **parts)
        return SessionFacts(config=config, outcomes=tuple(info.outcome for info in session.infos().values()))
