"""From images to what is known of the cloth: arrays in, arrays out; no simulator, no files."""

from perception.colour import learn_hsv, suggest_hsv
from perception.contact import contact_portion
from perception.descriptor import Descriptor, Direction
from perception.descriptors import DESCRIPTORS, descriptor
from perception.errors import PerceptionError
from perception.frame import SeenFrame, see_frame
from perception.lens import Lens
from perception.overlay import draw_percept
from perception.percept import Perceiver, Percept, PerceptionConfig
from perception.pinhole import Pinhole
from perception.plane import TablePlane, fit_plane
from perception.segmentation import HsvRange
from perception.sheet import Drawing, Light, Sheet, Wave, draw_sheet
from perception.tableview import ClothView, TableGrid
from perception.word import AXIAL, LETTER, Word, WordConfig, WordDescriptor, compute_word

__all__ = [
    "AXIAL",
    "DESCRIPTORS",
    "LETTER",
    "ClothView",
    "Descriptor",
    "Direction",
    "Drawing",
    "HsvRange",
    "Lens",
    "Light",
    "Perceiver",
    "Percept",
    "PerceptionConfig",
    "PerceptionError",
    "Pinhole",
    "SeenFrame",
    "Sheet",
    "TableGrid",
    "TablePlane",
    "Wave",
    "Word",
    "WordConfig",
    "WordDescriptor",
    "compute_word",
    "contact_portion",
    "descriptor",
    "draw_percept",
    "draw_sheet",
    "fit_plane",
    "learn_hsv",
    "see_frame",
    "suggest_hsv",
]
