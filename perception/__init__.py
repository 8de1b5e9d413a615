"""From images to what is known of the cloth: arrays in, arrays out; no simulator, no files."""

from perception.colour import learn_hsv, suggest_hsv
from perception.contact import contact_portion
from perception.descriptor import Descriptor, Direction
from perception.errors import PerceptionError
from perception.frame import SeenFrame, see_frame
from perception.lens import Lens
from perception.overlay import draw_percept
from perception.percept import Perceiver, Percept, PerceptionConfig
from perception.pinhole import Pinhole
from perception.plane import TablePlane, fit_plane
from perception.segmentation import HsvRange
from perception.tableview import ClothView, TableGrid
from perception.word import THESIS, Word, WordConfig, WordDescriptor, compute_word

__all__ = [
    "THESIS",
    "ClothView",
    "Descriptor",
    "Direction",
    "HsvRange",
    "Lens",
    "Perceiver",
    "Percept",
    "PerceptionConfig",
    "PerceptionError",
    "Pinhole",
    "SeenFrame",
    "TableGrid",
    "TablePlane",
    "Word",
    "WordConfig",
    "WordDescriptor",
    "compute_word",
    "contact_portion",
    "draw_percept",
    "fit_plane",
    "learn_hsv",
    "see_frame",
    "suggest_hsv",
]
