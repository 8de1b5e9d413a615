"""Pipeline from one RGB-D frame to the state of the cloth."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from layflat.perception.arrays import (
    BoolArray,
    Float32Array,
    Float64Array,
    FloatArray,
    RgbArray,
    bounding_window,
    touches_border,
)
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import ClothView, TableRectifier
from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.cloth.contact import contact_mask, contact_portion, covered_pixels, free_edge, smooth_height
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.perception.descriptors.base import Descriptor, WrinkleDirection
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, make_descriptor
from layflat.perception.errors import PerceptionError

VIEW_MARGIN_MM = 45.0
"""Table around the cloth in a descriptor's view: half of the largest kernel, so that no response depends on the cut."""


@dataclass(frozen=True, kw_only=True)
class PerceptionConfig:
    """Settings of the pipeline, apart from the camera."""

    color: HsvRange = field(default_factory=HsvRange)
    """Colour range of the cloth."""
    grid: TableGrid = field(default_factory=TableGrid)
    descriptor: Descriptor = field(default_factory=lambda: make_descriptor(DEFAULT_DESCRIPTOR))
    """Source of ``ClothState.word``."""
    contact_height_m: float = 0.008
    """Cloth no higher than this is in contact. A simulated cloth rests at 4 mm (its collision margin), and a D435 at
    1 m has 2-3 mm rms of noise, about 1 mm after smoothing (neighbours share errors): this is clear of both."""
    smoothing_px: int = 5
    """Side of the box, camera pixels, over which the cloth's height is averaged."""
    near_height_m: float = 0.03
    """Cloth below this is near the table: only that counts for ``out_of_view``."""
    min_area_px: int = 40
    """Smaller pieces of the cloth's colour are dropped, camera pixels."""

    def __post_init__(self) -> None:
        if not 0 < self.contact_height_m < self.near_height_m:
            raise PerceptionError(
                f"contact_height_m {self.contact_height_m} must be above 0 and below near_height_m {self.near_height_m}"
            )
        if self.smoothing_px < 1 or self.smoothing_px % 2 == 0:
            raise PerceptionError(f"smoothing_px is {self.smoothing_px}; it must be odd and positive")


@dataclass(frozen=True, kw_only=True, eq=False)
class ClothState:
    """Estimated state of the cloth in one frame. Masks (rows, columns) are in the table grid; arrays are read-only."""

    grid: TableGrid
    cloth_mask: BoolArray
    """Silhouette of the cloth; lifted parts are displaced away from the camera and may be cut by the grid's border."""
    contact_mask: BoolArray
    """Cloth that lies on the table."""
    cloth_pixels: int
    """Pixels of ``cloth_mask``; P_flat of Eq. 4-7 for a flat cloth."""
    contact_pixels: int
    """P_contact of Eq. 4-7."""
    contact_portion: float
    """Eq. 4-7, corrected for stretch (``cloth.contact.contact_portion``). NaN if flat_pixels is unknown."""
    word: Float64Array
    """(2,) wrinkle contraction direction: unit vector in table coordinates with x >= 0, or zeros if there is none."""
    coherence: float
    """Agreement of the wrinkles on one axis, 0..1."""
    strength: float
    """Depth of the wrinkles in the descriptor's unit, >= 0; 0 if there is no direction."""
    out_of_view: bool
    """True if cloth near the table touches the border of the image or of the grid, so that contact may be missed, or if
    no cloth is seen. A lifted part that leaves the image does not count."""
    free_edge_m: Float64Array | None = None
    """(3,) mean position of the lowest twentieth of the cloth, world, m: the free edge if the cloth hangs. None without
    cloth or if not measured."""

    def __post_init__(self) -> None:
        grid = (self.grid.height, self.grid.width)
        for name, shape in (("cloth_mask", grid), ("contact_mask", grid), ("word", (2,)), ("free_edge_m", (3,))):
            value = getattr(self, name)
            if value is None:
                continue
            view = value.view()
            if view.shape != shape:
                raise PerceptionError(f"{name} has shape {view.shape}; it must be {shape}")
            view.setflags(write=False)
            object.__setattr__(self, name, view)


class _RectifiedFrame(NamedTuple):
    """A frame before its wrinkles are described; masks in the table grid."""

    cloth: BoolArray
    contact: BoolArray
    view: ClothView | None
    free_edge_m: Float64Array | None
    out_of_view: bool


class PerceptionPipeline:
    """Estimates the state of the cloth from one camera: segmentation, contact, wrinkles (thesis 3-1-2). Stateless.

    ``flat_pixels`` is ``cloth_pixels`` of the flat cloth's state; without it ``contact_portion`` is NaN.
    """

    def __init__(
        self, camera: PinholeCamera, config: PerceptionConfig | None = None, flat_pixels: int | None = None
    ) -> None:
        if flat_pixels is not None and flat_pixels <= 0:
            raise PerceptionError(f"flat_pixels is {flat_pixels}; it must be positive, or None if unknown")
        self.camera = camera
        self.config = PerceptionConfig() if config is None else config
        self.flat_pixels = flat_pixels
        self.rectifier = TableRectifier(camera, self.config.grid)

    def with_flat_pixels(self, flat_pixels: int) -> PerceptionPipeline:
        """Return the same pipeline for a cloth that covers ``flat_pixels`` grid pixels when it is flat."""
        return PerceptionPipeline(self.camera, self.config, flat_pixels)

    def perceive(self, rgb: RgbArray, depth: FloatArray) -> ClothState:
        """Estimate the cloth's state from ``rgb`` (H, W, 3) and ``depth`` (H, W) m along the axis, 0 if missing."""
        return self.see(rgb, depth)[0]

    def see(
        self, rgb: RgbArray, depth: FloatArray, cloth: BoolArray | None = None
    ) -> tuple[ClothState, ClothView | None]:
        """Return the cloth's state, and a descriptor's input (None without cloth).

        ``cloth`` (H, W) says where the cloth is; without it the pixels of the configured colour are the cloth.
        """
        frame = self._rectify(rgb, depth, cloth)
        direction = WrinkleDirection.none() if frame.view is None else self.config.descriptor.direction(frame.view)
        contact_pixels = int(np.count_nonzero(frame.contact))
        state = ClothState(
            grid=self.config.grid,
            cloth_mask=frame.cloth,
            contact_mask=frame.contact,
            cloth_pixels=int(np.count_nonzero(frame.cloth)),
            contact_pixels=contact_pixels,
            contact_portion=self._contact_portion(contact_pixels, frame.view),
            word=direction.vector,
            coherence=direction.coherence,
            strength=direction.strength,
            free_edge_m=frame.free_edge_m,
            out_of_view=frame.out_of_view,
        )
        return state, frame.view

    def cloth_view(self, rgb: RgbArray, depth: FloatArray) -> ClothView | None:
        """Return a descriptor's input for a frame; None without cloth. Parameters as for ``perceive``."""
        return self._rectify(rgb, depth).view

    def _contact_portion(self, contact_pixels: int, view: ClothView | None) -> float:
        if self.flat_pixels is None:
            return math.nan
        heights = {"contact_height_m": self.config.contact_height_m, "camera_height_m": float(self.camera.position[2])}
        covered = 0.0 if view is None else covered_pixels(view.cloth, view.height, **heights)
        return contact_portion(contact_pixels, covered=covered, flat_pixels=self.flat_pixels)

    def _rectify(self, rgb: RgbArray, depth: FloatArray, image_cloth: BoolArray | None = None) -> _RectifiedFrame:
        """Find cloth and contact and resample them into the table grid."""
        expected = (self.camera.height, self.camera.width, 3)
        if rgb.shape != expected or rgb.dtype != np.uint8:
            raise PerceptionError(f"rgb is {rgb.dtype} of shape {rgb.shape}; this camera gives uint8 of {expected}")
        grid = self.config.grid
        contact = np.zeros((grid.height, grid.width), dtype=np.bool_)
        if image_cloth is None:
            image_cloth = segment(rgb, self.config.color, self.config.min_area_px)
        image_height, cut_by_image = self._cloth_height(image_cloth, depth)
        edge = free_edge(self.camera, image_cloth, depth)
        cloth = np.zeros_like(contact)
        covered = self.rectifier.grid_window(image_cloth)
        if covered is not None:
            cloth[covered] = self.rectifier.rectify_mask(image_cloth, covered)
        window = bounding_window(cloth, margin=math.ceil(VIEW_MARGIN_MM / grid.mm_per_px))
        if window is None:
            return _RectifiedFrame(cloth, contact, None, edge, cut_by_image or not image_cloth.any())
        height = self.rectifier.rectify(image_height, window)
        contact[window] = contact_mask(cloth[window], height, self.config.contact_height_m)
        near = np.zeros_like(cloth)
        near[window] = contact_mask(cloth[window], height, self.config.near_height_m)
        view = ClothView(
            rgb=self.rectifier.rectify(rgb, window),
            cloth=cloth[window],
            contact=contact[window],
            height=height,
            mm_per_px=grid.mm_per_px,
        )
        return _RectifiedFrame(cloth, contact, view, edge, cut_by_image or touches_border(near))

    def _cloth_height(self, cloth: BoolArray, depth: FloatArray) -> tuple[Float32Array, bool]:
        """Return the cloth's smoothed height (H, W) m in the camera image, and whether low cloth touches its border."""
        height = np.zeros(cloth.shape, dtype=np.float32)
        window = bounding_window(cloth, margin=2)
        if window is None:
            self.camera.height_above_table(depth, (slice(0), slice(0)))  # checks the shape
            return height, False
        part = cloth[window]
        height[window] = smooth_height(self.camera.height_above_table(depth, window), part, self.config.smoothing_px)
        near = np.zeros_like(cloth)
        near[window] = contact_mask(part, height[window], self.config.near_height_m)
        return height, touches_border(near)
