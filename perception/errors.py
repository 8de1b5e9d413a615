"""The exceptions of this package."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from layflat.perception.arrays import BoolArray


class PerceptionError(ValueError):
    """Base class of the errors that perception raises. The message says what is wrong, with which value, what to do."""


class ClothRefusedError(PerceptionError):
    """Refusal of what was found in a frame, which is no whole cloth: ``taken`` (H, W)."""

    def __init__(self, message: str, taken: BoolArray) -> None:
        super().__init__(message)
        self.taken = taken
