"""EditedEpisodes: the episodes of a session as its edits make them, by name."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, user_attributes
from layflat.data.format.content import CONTENT_KEYS, content_digest
from layflat.data.format.decode import read_demo
from layflat.data.format.demo_info import DemoInfo, info_of
from layflat.data.format.encode import arrays_of
from layflat.data.format.measures import Measures, measures_of
from layflat.data.format.opening import errors_name
from layflat.data.format.rows import demo_rows, read_rows
from layflat.data.format.structure_checks import stored_attributes
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
from layflat.data.session.session_writer import SessionFile
from layflat.data.types import Episode

_LOG = logging.getLogger("layflat")
_TRIMMED: dict[str, DemoInfo] = {}
"""Infos of trimmed episodes by their uid, as far as this process has read them: each needs its arrays."""


class EditedEpisodes:
    """Base of `Session`: a catalog of recorded episodes, read through the edit log."""

    def __init__(self, path: Path, *, edits: bool = True) -> None:
        self.path = path
        log = read_log(path) if edits else EditLog(path=log_path(path))
        if log.torn:
            _LOG.warning("layflat: %s", log.torn)
        self.catalog = Catalog(path)
        """All episodes as they were recorded, in their places in files."""
        self.edits: dict[str, EpisodeEdits] = log.by_episode(self.catalog)
        """Edits of the episodes that have any, dropped ones included, by name."""

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

    def episode(self, name: str, *, images: bool = True) -> Episode:
        """Read one episode, with ``images`` False without rgb and depth."""
        with errors_name(self._entry(name).file):
            return edited_episode(read_demo(self.catalog.group(name), images=images), self._edits(name))

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

    def measures(self, name: str) -> Measures:
        """Return the numbers that the flags of `layflat.data.tools.episode_index` depend on."""
        self._entry(name)
        if self._edits(name).bounds is None:
            return self.catalog.measures(name)
        keys = (schema.ACTIONS, schema.FINAL_STATE)[: 1 + (self.info(name).flat_area_final is not None)]
        return measures_of(self.attributes(name), {key: self.array(name, key) for key in keys})

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
