"""All descriptors by name. A new one adds a file and a line here, and inherits the conformance test."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from layflat.perception.descriptors.base import Descriptor
from layflat.perception.descriptors.hog import HogDescriptor
from layflat.perception.descriptors.how import HowDescriptor
from layflat.perception.descriptors.word import WordDescriptor, word_axial
from layflat.perception.errors import PerceptionError

DESCRIPTORS: Mapping[str, Callable[[], Descriptor]] = {
    "word": WordDescriptor,
    "word-axial": word_axial,
    "how": HowDescriptor,
    "hog": HogDescriptor,
}

DEFAULT_DESCRIPTOR = "word-axial"
"""The most accurate one in the tables of docs/explanation/results/word.md."""


def make_descriptor(name: str) -> Descriptor:
    """Return a descriptor with its default settings."""
    if name not in DESCRIPTORS:
        raise PerceptionError(f"descriptor {name!r} is unknown; it must be one of {', '.join(DESCRIPTORS)}")
    return DESCRIPTORS[name]()
