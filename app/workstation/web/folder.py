"""Folder: the files that the workstation shows, and the only ones that a page can name."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from layflat.app.support.errors import UsageError
from layflat.data.names import storable
from layflat.data.session.parts import part_files

SESSION, MODEL = ".h5", ".npz"


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
        suffix = f"{SESSION}.parts"
        parts = [path.name.removesuffix(".parts") for path in self.path.glob(f"*{suffix}") if path.is_dir()]
        started = [name for name in parts if not (self.path / name).exists() and part_files(self.path / name)]
        return [*started, *self._newest(f"*{SESSION}", Path.is_file)]

    def models(self) -> list[str]:
        """Return the names of the model files."""
        return self._newest(f"*{MODEL}", Path.is_file)

    def foreign(self) -> list[str]:
        """Return the names of files that may be data sets of other tools."""
        return self._newest("*.hdf5", Path.is_file)

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
        if name in (suffix, "", ".", "..") or name.startswith(".") or "\0" in name or Path(name).name != name:
            raise UsageError(f"{name!r} is not a name for a file here; give one without / and without a leading dot")
        if self.read_only:
            raise UsageError(f"{self.path} cannot be written; it can only be looked at")
        return self.path / name

    def _known(self, name: str, names: list[str]) -> Path:
        if name not in names:
            raise UsageError(f"{name or 'nothing'} is not in {self.path} any more; choose another one")
        return self.path / name

    def _newest(self, pattern: str, accept: Callable[[Path], bool]) -> list[str]:
        dated = []
        for path in self.path.glob(pattern):
            try:
                if path.name == storable(path.name) and not path.name.startswith(".") and accept(path):
                    dated.append((path.stat().st_mtime, path.name))
            except OSError:
                continue  # It has just been removed.
        return [name for _, name in sorted(dated, reverse=True)]
