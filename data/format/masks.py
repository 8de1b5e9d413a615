"""robomimic's filter keys: lists of demo names under /mask."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import h5py
import numpy as np

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.structure_checks import check_claim, check_stored_here
from layflat.data.types import OUTCOMES

OWN_MASKS = ("all", *OUTCOMES)
"""Filter keys made from the outcomes whenever a file is written; all others belong to users."""


def masks_of(outcomes: Mapping[str, str]) -> dict[str, list[str]]:
    """Return filter keys from outcomes by demo name: ``all``, and one for each outcome that occurs."""
    masks = {"all": list(outcomes)}
    for name, outcome in outcomes.items():
        masks.setdefault(outcome, []).append(name)
    return masks


def write_masks(file: h5py.File, masks: Mapping[str, Iterable[str]]) -> None:
    """Replace these filter keys; others stay."""
    for key, names in masks.items():
        path = f"{schema.MASK}/{key}"
        if path in file:
            del file[path]
        file.create_dataset(path, data=np.array([name.encode("ascii") for name in names], dtype="S"))


def read_masks(file: h5py.File, *, file_bytes: int) -> dict[str, tuple[str, ...]]:
    """Return all filter keys; DataError where one is not what robomimic reads."""
    masks = {}
    for key in file.get(schema.MASK, ()):
        path = f"/{schema.MASK}/{key}"
        if not isinstance(file[schema.MASK].get(key, getlink=True), h5py.HardLink):
            raise DataError(f"{path} is a link to elsewhere; a session holds its data itself")
        mask = file[path]
        if not isinstance(mask, h5py.Dataset) or mask.dtype.kind != "S" or len(mask.shape or ()) != 1:
            raise DataError(
                f"{path} must be a list of names of fixed length (numpy's dtype S), as robomimic writes them"
            )
        check_stored_here(mask, path)
        check_claim(mask, path, file_bytes)
        masks[str(key)] = tuple(bytes(name).decode("utf-8", "replace") for name in mask[()])
    return masks
