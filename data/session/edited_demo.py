"""A recorded demo as its edits make it: attributes, rows and episode, computed without writing anything."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute
from layflat.data.format.decode import disturbances_of
from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.encode import disturbances_json
from layflat.data.format.rows import read_rows
from layflat.data.session.edit_log import EpisodeEdits
from layflat.data.types import Episode, Outcome, StoppedBy, disturbances_within

AT_REST = 0.01
"""Largest difference of contact portion and flat area between a cloth that lies and the same one some steps later."""
TRIM_KEYS = (
    f"{schema.OBS}/contact_portion",
    f"{schema.NEXT_OBS}/contact_portion",
    schema.CONTACT_TRUE,
    schema.FLAT_AREA,
)
"""Data sets that the attributes of a trimmed demo come from."""


def trimmed(episode: Episode, start: int, stop: int) -> Episode:
    """Return the steps ``start`` to ``stop - 1`` of an episode.

    Without its end it is ``partial`` and was ``interrupted``, unless the cloth lay there as at the end.
    """
    n_steps = len(episode.steps)
    if not 0 <= start < stop <= n_steps:
        raise DataError(f"steps {start} to {stop} cannot be kept; the episode has steps 0 to {n_steps}")
    cut = replace(
        episode,
        steps=episode.steps[start:stop],
        first_step=episode.first_step + start,
        disturbances=disturbances_within(episode.disturbances, start, stop),
    )
    if stop == n_steps:
        return cut
    after, truth = episode.steps[stop], episode.final_ground_truth
    ends = [(after.observation.contact_portion, episode.final_observation.contact_portion)]
    if after.ground_truth is not None and truth is not None:
        ends.append((after.ground_truth.flat_area, truth.flat_area))
    outcome, stopped_by = _label(episode.outcome, episode.stopped_by, *ends)
    return replace(
        cut,
        final_observation=after.observation,
        final_ground_truth=after.ground_truth,
        outcome=outcome,
        stopped_by=stopped_by,
    )


def edited_episode(episode: Episode, edits: EpisodeEdits) -> Episode:
    """Return an episode with its edits."""
    if edits.bounds is not None:
        episode = trimmed(episode, *edits.bounds)
    return episode if edits.outcome is None else replace(episode, outcome=edits.outcome)


def edited_info(info: DemoInfo, edits: EpisodeEdits) -> DemoInfo:
    """Return the info of an episode, trimmed already, with its label and note."""
    outcome = info.outcome if edits.outcome is None else edits.outcome
    return replace(info, outcome=outcome, note=info.note if edits.note is None else edits.note)


def edited_attributes(
    attributes: Mapping[str, Attribute], group: h5py.Group, edits: EpisodeEdits
) -> dict[str, Attribute]:
    """Return the attributes of a demo with its edits; ``group`` is checked for TRIM_KEYS where it is trimmed."""
    found = dict(attributes)
    if edits.bounds is not None:
        found |= _trimmed_attributes(attributes, group, *edits.bounds)
    if edits.outcome is not None:
        found[schema.OUTCOME] = edits.outcome
    found[schema.SUCCESS] = found[schema.OUTCOME] == "success"
    if edits.note is not None:
        found.pop(schema.NOTE, None)
        found |= {schema.NOTE: edits.note} if edits.note else {}
    return found


def edited_rows(group: h5py.Group, key: str, bounds: tuple[int, int], rows: slice = slice(None)) -> NDArray[Any]:
    """Return rows of a data set of a checked demo that is cut to the steps ``bounds``."""
    start, stop = bounds
    length = schema.FIELDS[key].shape[0]
    if key == schema.DONES:
        return (np.arange(start + 1, stop + 1) == stop).astype(schema.FIELDS[key].dtype)[rows]
    if key == schema.FINAL_STATE and stop < len(group[schema.PHASE]):
        return cast(NDArray[Any], group[schema.STATES][stop])[rows]
    if length not in ("N", "N+1"):
        return read_rows(group, key, rows)
    first, last, step = rows.indices(stop - start + (length == "N+1"))
    if step < 1:
        return edited_rows(group, key, bounds)[rows]
    return read_rows(group, key, slice(start + first, start + last, step))


def cut_rows(rows: Mapping[str, NDArray[Any]], bounds: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """Return the rows of `layflat.data.format.rows.demo_rows` of a demo that is cut to the steps ``bounds``."""
    start, stop = bounds
    per_step = {field.key for field in schema.STEP_FIELDS}
    return {key: values[start : stop + (key not in per_step)] for key, values in rows.items()}


def trimmed_uid(uid: str, start: int, stop: int) -> str:
    """Return the identity of an episode that was cut: no longer the recording's, and the same each time."""
    return hashlib.sha256(f"{uid} {start} {stop}".encode()).hexdigest()[:32]


def _trimmed_attributes(
    attributes: Mapping[str, Attribute], group: h5py.Group, start: int, stop: int
) -> dict[str, Attribute]:
    before, after, true_contact, flat_area = TRIM_KEYS
    contact = float(group[after][stop - 1, 0])
    records = disturbances_within(disturbances_of(attributes), start, stop)
    found: dict[str, Attribute] = {
        schema.UID: trimmed_uid(str(attributes[schema.UID]), start, stop),
        schema.NUM_SAMPLES: stop - start,
        schema.FIRST_STEP: int(attributes[schema.FIRST_STEP]) + start,
        schema.DISTURBANCES: disturbances_json(records),
        schema.CONTACT_START: float(group[before][start, 0]),
        schema.CONTACT_FINAL: contact,
    }
    ends = [(contact, float(attributes[schema.CONTACT_FINAL]))]
    if schema.FLAT_AREA_FINAL in attributes:
        found[schema.CONTACT_TRUE_FINAL] = float(group[true_contact][stop, 0])
        found[schema.FLAT_AREA_FINAL] = float(group[flat_area][stop, 0])
        ends.append((float(found[schema.FLAT_AREA_FINAL]), float(attributes[schema.FLAT_AREA_FINAL])))
    if stop < int(attributes[schema.NUM_SAMPLES]):
        outcome, stopped_by = cast(Outcome, attributes[schema.OUTCOME]), cast(StoppedBy, attributes[schema.STOPPED_BY])
        found[schema.OUTCOME], found[schema.STOPPED_BY] = _label(outcome, stopped_by, *ends)
    return found


def _label(outcome: Outcome, stopped_by: StoppedBy, *ends: tuple[float, float]) -> tuple[Outcome, StoppedBy]:
    """Return outcome and reason of the end of an episode without its end; ``ends``: values then and at its end."""
    same = all(abs(here - there) <= AT_REST for here, there in ends)
    return (outcome, stopped_by) if same else ("partial", "interrupted")
