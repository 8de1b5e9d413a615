"""From images to what is known of the cloth: arrays in, arrays out; no simulator, no files."""

from layflat.perception.camera.intrinsics import Lens
from layflat.perception.camera.pinhole import Pinhole
from layflat.perception.camera.rectified_view import ClothView, TableGrid
from layflat.perception.camera.table_plane import TablePlane, fit_plane
from layflat.perception.cloth.analyze_frame import SeenFrame, see_frame
from layflat.perception.cloth.color_calibration import learn_hsv, suggest_hsv
from layflat.perception.cloth.contact import contact_portion
from layflat.perception.cloth.pipeline import Perceiver, Percept, PerceptionConfig
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.descriptors.base import Descriptor, Direction
from layflat.perception.descriptors.registry import DESCRIPTORS, descriptor
from layflat.perception.descriptors.word import AXIAL, LETTER, Word, WordConfig, WordDescriptor, compute_word
from layflat.perception.errors import PerceptionError
from layflat.perception.overlay import draw_percept
from layflat.perception.synthetic_sheet import Drawing, Light, Sheet, Wave, draw_sheet

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
