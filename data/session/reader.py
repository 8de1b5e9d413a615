"""Reads sessions: checks them first, and finds every saved episode also after a killed recording.

While a session is recorded, its newest episodes are in files of their own in the folder ``FILE.h5.parts``; the recorder
moves them into ``FILE.h5``. A reader shows both as one and writes nothing, so that it may look at any moment.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, overload

from numpy.typing import NDArray

from layflat.data.camera import CameraModel
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import json_object
from layflat.data.format.content import STEP_KEYS, copies_among, repeated_steps
from layflat.data.format.decode import disturbances_of
from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.opening import errors_name
from layflat.data.format.rows import concatenated
from layflat.data.format.structure_checks import camera_of
from layflat.data.robot import RobotSpec
from layflat.data.session.edited_episodes import EditedEpisodes
from layflat.data.session.episode_view import EpisodeView
from layflat.data.types import DisturbanceRecord, Episode, Outcome


def open_session(path: str | Path, *, edits: bool = True) -> Session:
    """Open a recorded session for reading.

    Parameters
    ----------
    path : str or Path
        The session's ``.h5`` file.
    edits : bool
        Apply the session's edit log (`layflat.data.session.edit_log`): dropped episodes are absent, trimmed and
        relabelled ones are as edited, in everything that is read. False: all as it was recorded.

    Returns
    -------
    Session
        A lazy sequence of episodes; close it, or use it in a ``with`` statement.

    Raises
    ------
    DataError
        If the file is not a session, or its edit log cannot be used. An error in a single episode is raised at the
        latest when that episode is read.
    """
    return Session(Path(path), edits=edits)


class Session(EditedEpisodes, Sequence[Episode]):
    """A lazy sequence of recorded episodes of one robot with one cloth, oldest first.

    ``session[3]``, ``session[-1]`` and ``session["demo_3"]`` read one episode; ``session[2:5]`` and
    ``session.view(names)`` are sequences that read each episode when it is asked for. The file is open until `close`.

    Attributes
    ----------
    path : Path
        The session's file.
    robot : RobotSpec
        Robot of all episodes.
    task, physics, cloth, descriptor : str
        Names that all episodes share.
    step_s : float
        Simulated duration of one step in seconds.
    """

    def __init__(self, path: Path, *, edits: bool = True) -> None:
        super().__init__(path, edits=edits)
        self.robot: RobotSpec = self.catalog.robot
        self.shared = self.catalog.shared
        """Attributes that all episodes share, by key of the schema."""
        self.task, self.physics = str(self.shared[schema.TASK]), str(self.shared[schema.PHYSICS])
        self.cloth, self.descriptor = str(self.shared[schema.CLOTH]), str(self.shared[schema.DESCRIPTOR])
        self.step_s = float(self.shared[schema.STEP_S])

    @property
    def camera(self) -> CameraModel | None:
        """Camera of the first episode, or None where it is not known; `episode` has that of each episode."""
        return self.camera_of(self.names[0]) if self.names else None

    def camera_of(self, name: str) -> CameraModel | None:
        """Return the camera of an episode, or None where it is not known; its arrays are not read."""
        with errors_name(self._entry(name).file):
            return camera_of(self.attributes(name))

    def infos(self) -> dict[str, DemoInfo]:
        """Return the info of every episode by name; no array is read.

        Returns
        -------
        dict of str to DemoInfo
            Seed, outcome, number of steps, contact portions, ... by name.
        """
        return {name: self.info(name) for name in self.names}

    def episodes(self, *, images: bool = True) -> Iterator[Episode]:
        """Read all episodes in order, one in memory at a time."""
        return (self.episode(name, images=images) for name in self.names)

    def disturbances(self, name: str) -> tuple[DisturbanceRecord, ...]:
        """Return the disturbances of an episode; its arrays are not read."""
        with errors_name(self._entry(name).file):
            return disturbances_of(self.attributes(name))

    def contents(self, names: Sequence[str] | None = None) -> dict[str, str]:
        """Return the digest of each episode's content; episodes with the same digest are copies of one another."""
        return {name: self._content(name) for name in (self.names if names is None else names)}

    def copies(self, names: Sequence[str] | None = None) -> dict[str, str]:
        """Return the episodes whose content an earlier one of ``names`` has, each with the name of the first."""
        return copies_among(self.contents(names))

    def recordings(self, names: Sequence[str] | None = None) -> dict[str, str]:
        """Return for each episode the first one of ``names`` that it is a copy of or shares steps with, or itself.

        What shares steps (a copy, a trimmed copy) must not be divided between learning and testing.
        """
        contents = self.contents(names)
        copies = copies_among(contents)
        single = [name for name in contents if name not in copies]
        groups, _ = repeated_steps(
            [self.info(name).seed for name in single],
            lambda number: [self.array(single[number], key) for key in STEP_KEYS],
        )
        first = dict(zip(single, (single[group] for group in groups), strict=True))
        return {name: first[copies.get(name, name)] for name in contents}

    def settings(self, name: str) -> dict[str, Any]:
        """Return the settings of the simulation of an episode, such as its ``start``; its arrays are not read."""
        with errors_name(self._entry(name).file):
            return json_object(self.attributes(name), schema.SIM_CONFIG)

    def view(self, names: Sequence[str], *, images: bool = True) -> EpisodeView:
        """Return these episodes as a sequence that reads each when it is asked for."""
        for name in names:
            self._entry(name)
        return EpisodeView(self, tuple(names), images=images)

    def arrays(self, keys: Sequence[str], names: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
        """Read columns for learning: the steps of several episodes one after another.

        Parameters
        ----------
        keys : sequence of str
            Data sets with one row per step: ``obs/word``, ``next_obs/contact_portion``, ``action_m``, ``phase``,
            ``intervention``, ``states``, ... (docs/reference/session-file.md lists all of them with units and frames).
        names : sequence of str, optional
            Episodes by name; all by default.

        Returns
        -------
        dict of str to ndarray
            For each key an array (T, ...), T being the number of steps of all these episodes together. Always there:
            ``episode`` (T,), the position in ``names``, and ``step`` (T,), the step within the episode.

        Raises
        ------
        DataError
            If a key is unknown or has no row per step, or an episode is damaged or was recorded without it.
        """
        chosen = self.names if names is None else tuple(names)
        for key in keys:
            if key not in schema.STEP_KEYS:
                raise DataError(f"{key!r} has no row per step; those that have are {', '.join(schema.STEP_KEYS)}")
        lengths = [self.info(name).n_steps for name in chosen]
        for name in chosen:
            self.check(name, keys)
        return concatenated(keys, lengths, (partial(self.array, name) for name in chosen))

    def select(self, *, outcome: Outcome | None = None, source: str | None = None) -> tuple[str, ...]:
        """Return the names of the episodes with this outcome and source; None takes any."""
        return tuple(
            name
            for name, info in self.infos().items()
            if outcome in (None, info.outcome) and source in (None, info.source)
        )

    def close(self) -> None:
        """Close the file."""
        self.catalog.close()

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[Episode]:
        return self.episodes()

    def __contains__(self, name: object) -> bool:
        return name in self.catalog.demos and name not in self.dropped

    @overload
    def __getitem__(self, which: int | str) -> Episode: ...
    @overload
    def __getitem__(self, which: slice) -> EpisodeView: ...
    def __getitem__(self, which: int | str | slice) -> Episode | EpisodeView:
        if isinstance(which, str):
            return self.episode(which)
        return EpisodeView(self, self.names)[which]

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
