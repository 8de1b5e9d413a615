"""EpisodeView: some episodes of a session as a sequence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, overload

from numpy.typing import NDArray

from layflat.data.format.demo_info import DemoInfo
from layflat.data.types import Episode


class EpisodeSource(Protocol):
    """A session as a view needs it."""

    def info(self, name: str) -> DemoInfo:
        """Return the info of an episode."""

    def episode(self, name: str, *, images: bool = True) -> Episode:
        """Read one episode."""

    def arrays(self, keys: Sequence[str], names: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
        """Read columns of episodes."""


class EpisodeView(Sequence[Episode]):
    """Some episodes of a session, each read when it is asked for; usable while the session is open."""

    def __init__(self, session: EpisodeSource, names: tuple[str, ...], *, images: bool = True) -> None:
        self.names = names
        self._session = session
        self._images = images

    def infos(self) -> dict[str, DemoInfo]:
        """Return the info of these episodes by name."""
        return {name: self._session.info(name) for name in self.names}

    def arrays(self, keys: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read columns of these episodes, as `Session.arrays` does."""
        return self._session.arrays(keys, self.names)

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, which: int) -> Episode: ...
    @overload
    def __getitem__(self, which: slice) -> EpisodeView: ...
    def __getitem__(self, which: int | slice) -> Episode | EpisodeView:
        if isinstance(which, slice):
            return EpisodeView(self._session, self.names[which], images=self._images)
        return self._session.episode(self.names[which], images=self._images)
