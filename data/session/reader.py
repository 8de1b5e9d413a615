"""Reads sessions: checks them first, and finds every saved episode also after a killed recording.

While a session is recorded, its newest episodes are in files of their own in the folder ``FILE.h5.parts``; the recorder
moves them into ``FILE.h5``. A reader shows both as one and writes nothing, so that it may look at any moment.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, overload

from numpy.typing import NDArray

from layflat.data.camera import CameraModel
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object, user_attributes
from layflat.data.format.content import CONTENT_KEYS, STEP_KEYS, content_digest, copies_among, repeated_steps
from layflat.data.format.decode import disturbances_of, read_demo
from layflat.data.format.demo_info import DemoInfo, info_of
from layflat.data.format.encode import arrays_of
from layflat.data.format.measures import Measures, measures_of
from layflat.data.format.opening import errors_name
from layflat.data.format.rows import concatenated, demo_rows, read_rows
from layflat.data.format.structure_checks import camera_of, stored_attributes
from layflat.data.robot import RobotSpec
from layflat.data.session.catalog import Catalog, CatalogEntry
from layflat.data.session.edit_log import UNEDITED, Edit, EditLog, EpisodeEdits, log_path, read_log
from layflat.data.session.edited_demo import (
    TRIM_KEYS,
    cut_rows,
    edited_attributes,
    edited_episode,
    edited_info,
    edited_rows,
    trimmed_uid,
)
from layflat.data.session.episode_view import EpisodeView
from layflat.data.session.session_writer import SessionFile
from layflat.data.types import DisturbanceRecord, Episode, Outcome

_LOG = logging.getLogger("layflat")
_TRIMMED: dict[str, DemoInfo] = {}
"""Infos of trimmed episodes by their uid, as far as this process has read them: each needs its arrays."""


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


class Session(Sequence[Episode]):
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
        self.path = path
        log = read_log(path) if edits else EditLog(path=log_path(path))
        if log.torn:
            _LOG.warning("layflat: %s", log.torn)
        self.catalog = Catalog(path)
        """All episodes as they were recorded, in their places in files."""
        self.edits: dict[str, EpisodeEdits] = log.by_episode(self.catalog)
        """Edits of the episodes that have any, dropped ones included, by name."""
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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the episodes by number: demo_0, demo_1, ...; a dropped one leaves a gap."""
        return tuple(name for name in self.catalog.demos if name not in self.dropped)

    @property
    def dropped(self) -> Mapping[str, Edit]:
        """Dropped episodes by name, with the edit that dropped each."""
        return {name: edits.dropped for name, edits in self.edits.items() if edits.dropped is not None}

    def info(self, name: str) -> DemoInfo:
        """Return everything about an episode that needs no array."""
        info, edits = self._entry(name).row.info, self._edits(name)
        if edits.bounds is not None:
            uid = trimmed_uid(info.uid, *edits.bounds)
            if uid not in _TRIMMED:
                attributes = self._attributes(name, EpisodeEdits(bounds=edits.bounds))
                _TRIMMED[uid] = info_of(attributes, images=info.images)
            info = _TRIMMED[uid]
        return edited_info(info, edits)

    def infos(self) -> dict[str, DemoInfo]:
        """Return the info of every episode by name; no array is read.

        Returns
        -------
        dict of str to DemoInfo
            Seed, outcome, number of steps, contact portions, ... by name.
        """
        return {name: self.info(name) for name in self.names}

    def episode(self, name: str, *, images: bool = True) -> Episode:
        """Read one episode, with ``images`` False without rgb and depth."""
        with errors_name(self._entry(name).file):
            return edited_episode(read_demo(self.catalog.group(name), images=images), self._edits(name))

    def episodes(self, *, images: bool = True) -> Iterator[Episode]:
        """Read all episodes in order, one in memory at a time."""
        return (self.episode(name, images=images) for name in self.names)

    def attributes(self, name: str) -> dict[str, Attribute]:
        """Return the attributes of an episode by key of the schema; its arrays are not read."""
        return self._attributes(name, self._edits(name))

    def _attributes(self, name: str, edits: EpisodeEdits) -> dict[str, Attribute]:
        entry = self._entry(name)
        with errors_name(entry.file):
            group = self.catalog.group(name, () if entry.checked else (schema.PHASE,))
            attributes = stored_attributes(group)
            if edits.bounds is not None:
                group = self.catalog.group(name, [key for key in TRIM_KEYS if key in group])
            return edited_attributes(attributes, group, edits)

    def disturbances(self, name: str) -> tuple[DisturbanceRecord, ...]:
        """Return the disturbances of an episode; its arrays are not read."""
        with errors_name(self._entry(name).file):
            return disturbances_of(self.attributes(name))

    def contents(self, names: Sequence[str] | None = None) -> dict[str, str]:
        """Return the digest of each episode's content; episodes with the same digest are copies of one another."""
        return {name: self._content(name) for name in (self.names if names is None else names)}

    def measures(self, name: str) -> Measures:
        """Return the numbers that the flags of `layflat.data.tools.episode_index` depend on."""
        self._entry(name)
        if self._edits(name).bounds is None:
            return self.catalog.measures(name)
        keys = (schema.ACTIONS, schema.FINAL_STATE)[: 1 + (self.info(name).flat_area_final is not None)]
        return measures_of(self.attributes(name), {key: self.array(name, key) for key in keys})

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

    def array(self, name: str, key: str, rows: slice = slice(None)) -> NDArray[Any]:
        """Read rows of one data set of one episode, such as ``obs/word`` or ``action_m``; only these rows are read."""
        if key not in schema.FIELDS:
            raise DataError(f"{key!r} is no data set of an episode; known ones are {', '.join(schema.FIELDS)}")
        bounds = self._edits(name).bounds
        with errors_name(self._entry(name).file):
            if bounds is None:
                return read_rows(self.catalog.group(name, (key,)), key, rows)
            needed = (schema.STATES, key) if key == schema.FINAL_STATE else (key,)
            return edited_rows(self.catalog.group(name, (*needed, schema.PHASE)), key, bounds, rows)

    def rows(self, name: str, *, images: bool) -> dict[str, NDArray[Any]]:
        """Return all rows of an episode as `layflat.data.format.rows.demo_rows` does."""
        bounds = self._edits(name).bounds
        with errors_name(self._entry(name).file):
            rows = demo_rows(self.catalog.group(name), images=images)
        return rows if bounds is None else cut_rows(rows, bounds)

    def row_shape(self, name: str, key: str) -> tuple[int, ...] | None:
        """Return the shape of one row of a data set of an episode, or None where it was recorded without it."""
        with errors_name(self._entry(name).file):
            group = self.catalog.group(name)
            return tuple(group[key].shape[1:]) if key in group else None

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

    def copy_to(self, file: SessionFile, name: str, new_name: str | None = None) -> None:
        """Copy an episode with its edits to a session that is being written; what was recorded is copied bit by bit."""
        entry, edits = self._entry(name), self._edits(name)
        with errors_name(entry.file):
            group = self.catalog.group(name)
        if edits == UNEDITED:
            file.copy(new_name or name, group, entry.row.info)
        elif edits.bounds is None:
            file.copy(new_name or name, group, self.info(name), self.attributes(name))
        else:
            file.write(
                new_name or name,
                self.attributes(name),
                arrays_of(self.episode(name), save_images=True),
                users=user_attributes(group),
            )

    def preview_trim(self, name: str, start: int, stop: int) -> None:
        """Cut an episode to its steps ``start`` to ``stop - 1`` in this reader only; nothing is written."""
        n_steps, edits = self.info(name).n_steps, self._edits(name)
        if not 0 <= start < stop <= n_steps:
            raise DataError(f"steps {start} to {stop} cannot be kept; the episode has steps 0 to {n_steps}")
        before = 0 if edits.bounds is None else edits.bounds[0]
        self.edits[name] = replace(edits, bounds=(before + start, before + stop))

    def check(self, name: str, keys: Sequence[str]) -> None:
        """Check several data sets of an episode at once, which is faster than one by one as they are read."""
        with errors_name(self._entry(name).file):
            self.catalog.group(name, keys)

    def close(self) -> None:
        """Close the file."""
        self.catalog.close()

    def _entry(self, name: str) -> CatalogEntry:
        """Return the place of an episode; DataError where it does not exist or is dropped."""
        entry = self.catalog.entry(name)
        if (edit := self._edits(name).dropped) is not None:
            raise DataError(
                f"{self.path} has {name} no more: {edit.who} dropped it on {edit.when_utc[:10]};"
                f" `layflat data edit {self.path} restore {name}` brings it back"
            )
        return entry

    def _edits(self, name: str) -> EpisodeEdits:
        return self.edits.get(name, UNEDITED)

    def _content(self, name: str) -> str:
        self._entry(name)
        if self._edits(name).bounds is None:
            return self.catalog.content(name)
        there = [
            key for key in CONTENT_KEYS if key != schema.FINAL_STATE or self.info(name).flat_area_final is not None
        ]
        return content_digest({key: self.array(name, key) for key in there})

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
