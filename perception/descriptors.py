"""Every descriptor by name; a new one adds a file and a line here, and inherits the conformance test."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from perception.descriptor import Descriptor
from perception.errors import PerceptionError
from perception.hog import HogDescriptor
from perception.how import HowDescriptor
from perception.word import WordDescriptor, word_axial

DESCRIPTORS: Mapping[str, Callable[[], Descriptor]] = {
    "word": WordDescriptor,
    "word-axial": word_axial,
    "how": HowDescriptor,
    "hog": HogDescriptor,
}

DEFAULT = "word-axial"
"""By the tables of docs/word.md."""


def descriptor(name: str) -> Descriptor:
    """A descriptor with its default settings; PerceptionError lists the known ones."""
    if name not in DESCRIPTORS:
        raise PerceptionError(f"descriptor {name!r} is unknown; it must be one of {', '.join(DESCRIPTORS)}")
    return DESCRIPTORS[name]()
