"""From images to what is known of the cloth: arrays in, arrays out; no simulator, no files."""

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import ClothView, TableGrid
from layflat.perception.camera.table_plane import TablePlane, fit_table_plane
from layflat.perception.cloth.analyze_frame import FrameResult, analyze_frame
from layflat.perception.cloth.color_calibration import learn_hsv, suggest_hsv
from layflat.perception.cloth.contact import contact_portion
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
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
    "ClothState",
    "ClothView",
    "Descriptor",
    "Direction",
    "Drawing",
    "FrameResult",
    "HsvRange",
    "Intrinsics",
    "Light",
    "PerceptionConfig",
    "PerceptionError",
    "PerceptionPipeline",
    "PinholeCamera",
    "Sheet",
    "TableGrid",
    "TablePlane",
    "Wave",
    "Word",
    "WordConfig",
    "WordDescriptor",
    "analyze_frame",
    "compute_word",
    "contact_portion",
    "descriptor",
    "draw_percept",
    "draw_sheet",
    "fit_table_plane",
    "learn_hsv",
    "suggest_hsv",
]
