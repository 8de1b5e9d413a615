"""From one RGB-D frame to what is known of the cloth: PerceptionPipeline composes, ClothState is the result."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from layflat.perception.camera.pinhole import FloatArray, PinholeCamera
from layflat.perception.camera.rectified_view import (
    BoolArray,
    ClothView,
    TableGrid,
    TableRectifier,
    bounding_window,
    touches_border,
)
from layflat.perception.cloth.contact import contact_mask, contact_portion, covered_pixels, smooth_height
from layflat.perception.cloth.free_edge import free_edge
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.perception.descriptors.base import Descriptor, WrinkleDirection
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, make_descriptor
from layflat.perception.errors import PerceptionError

VIEW_MARGIN_MM = 45.0
"""Table around the cloth in a descriptor's view: half of the largest kernel, so that no answer depends on the cut."""


@dataclass(frozen=True, kw_only=True)
class PerceptionConfig:
    """Everything about seeing that is not the camera."""

    color: HsvRange = field(default_factory=HsvRange)
    grid: TableGrid = field(default_factory=TableGrid)
    descriptor: Descriptor = field(default_factory=lambda: make_descriptor(DEFAULT_DESCRIPTOR))
    """What ``word`` is taken from."""
    contact_height_m: float = 0.008
    """Cloth no higher than this is in contact. A simulated cloth rests at 4 mm (its collision margin), and a D435 at
    1 m has 2-3 mm rms of noise, about 1 mm after smoothing (neighbours share errors): this stands clear of both."""
    smoothing_px: int = 5
    """Side of the box, in camera pixels, over which cloth height is averaged."""
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
    """What one frame says about the cloth. Masks are in the table grid, read-only."""

    grid: TableGrid
    cloth_mask: BoolArray
    """(rows, columns) of the grid: the cloth's silhouette; lifted parts are displaced away from the camera, and may
    be cut off by the grid's border."""
    contact_mask: BoolArray
    """(rows, columns) of the grid: where the cloth lies on the table."""
    cloth_pixels: int
    """Grid pixels of cloth_mask; of a flat cloth, P_flat of Eq. 4-7."""
    contact_pixels: int
    """P_contact of Eq. 4-7."""
    contact_portion: float
    """Eq. 4-7 for a cloth that may be stretched: see layflat.perception.cloth.contact. NaN if flat_pixels is not
    known."""
    word: NDArray[np.float64]
    """(2,) wrinkle contraction direction by the descriptor: unit vector in table coordinates with x >= 0, or zeros
    where there is no direction."""
    coherence: float
    """0..1: how far the wrinkles agree on one axis."""
    strength: float
    """>= 0: depth of the wrinkles in the descriptor's unit; 0 where there is no direction."""
    out_of_view: bool
    """True if cloth near the table touches the border of the image or of the grid, so that contact may go uncounted,
    or if no cloth is seen at all. A lifted part that leaves the image does not count."""

    free_edge_m: NDArray[np.float64] | None = None
    """(3,) m, world: mean place of the cloth's lowest twentieth, of a hanging cloth its free edge; None without cloth,
    or where nobody has measured it."""

    def __post_init__(self) -> None:
        shape = (self.grid.height, self.grid.width)
        for name, dtype, wanted in (
            ("cloth_mask", np.bool_, shape),
            ("contact_mask", np.bool_, shape),
            ("word", np.float64, (2,)),
        ):
            object.__setattr__(self, name, _frozen(getattr(self, name), dtype, wanted, name))
        if self.free_edge_m is not None:
            object.__setattr__(self, "free_edge_m", _frozen(self.free_edge_m, np.float64, (3,), "free_edge_m"))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """A frame before its wrinkles are looked at; masks in the table grid."""

    cloth: BoolArray
    contact: BoolArray
    view: ClothView | None
    free_edge_m: NDArray[np.float64] | None
    out_of_view: bool


class PerceptionPipeline:
    """Sees the cloth through one camera: segmentation, contact, wrinkles (thesis 3-1-2), without memory."""

    def __init__(
        self, camera: PinholeCamera, config: PerceptionConfig | None = None, flat_pixels: int | None = None
    ) -> None:
        """``flat_pixels`` is ``cloth_pixels`` of a cloth_state of the flat cloth; without it contact_portion is NaN."""
        if flat_pixels is not None and flat_pixels <= 0:
            raise PerceptionError(f"flat_pixels is {flat_pixels}; it must be positive, or None where it is not known")
        self.camera = camera
        self.config = PerceptionConfig() if config is None else config
        self.flat_pixels = flat_pixels
        self.view = TableRectifier(camera, self.config.grid)

    def with_flat_pixels(self, flat_pixels: int) -> PerceptionPipeline:
        """The same perceiver, for a cloth that covers ``flat_pixels`` grid pixels when it is flat."""
        return PerceptionPipeline(self.camera, self.config, flat_pixels)

    def perceive(self, rgb: NDArray[np.uint8], depth: FloatArray) -> ClothState:
        """Image (H, W, 3) uint8 and depth (H, W) m along the optical axis, 0 where missing -> ClothState."""
        seen = self._look(rgb, depth)
        direction = WrinkleDirection.none() if seen.view is None else self.config.descriptor.direction(seen.view)
        contact = int(np.count_nonzero(seen.contact))
        return ClothState(
            grid=self.config.grid,
            cloth_mask=seen.cloth,
            contact_mask=seen.contact,
            cloth_pixels=int(np.count_nonzero(seen.cloth)),
            contact_pixels=contact,
            contact_portion=self._portion(contact, seen.view),
            word=direction.vector,
            coherence=direction.coherence,
            strength=direction.strength,
            free_edge_m=seen.free_edge_m,
            out_of_view=seen.out_of_view,
        )

    def _portion(self, contact_pixels: int, view: ClothView | None) -> float:
        if self.flat_pixels is None:
            return math.nan
        camera, level = float(self.camera.position[2]), self.config.contact_height_m
        covered = 0.0 if view is None else covered_pixels(view.cloth, view.height, level_m=level, camera_m=camera)
        return contact_portion(contact_pixels, covered=covered, flat_pixels=self.flat_pixels)

    def cloth_view(self, rgb: NDArray[np.uint8], depth: FloatArray) -> ClothView | None:
        """What descriptors are given of a frame; None without cloth. Arguments as of ``perceive``."""
        return self._look(rgb, depth).view

    def _look(self, rgb: NDArray[np.uint8], depth: FloatArray) -> _Seen:
        """Segmentation and contact in the table grid."""
        self._check(rgb)
        grid = self.config.grid
        contact = np.zeros((grid.height, grid.width), dtype=np.bool_)
        cloth_seen = segment(rgb, self.config.color, self.config.min_area_px)
        height_seen, cut_by_image = self._cloth_height(cloth_seen, depth)
        lowest = free_edge(self.camera, cloth_seen, depth)
        cloth = np.zeros_like(contact)
        part = self.view.window_of(cloth_seen)
        if part is not None:
            cloth[part] = self.view.rectify_mask(cloth_seen, part)
        window = bounding_window(cloth, margin=math.ceil(VIEW_MARGIN_MM / grid.mm_per_px))
        if window is None:
            out_of_view = cut_by_image or not cloth_seen.any()
            return _Seen(cloth=cloth, contact=contact, view=None, free_edge_m=lowest, out_of_view=out_of_view)
        height = self.view.rectify(height_seen, window)
        contact[window] = contact_mask(cloth[window], height, self.config.contact_height_m)
        near = np.zeros_like(cloth)
        near[window] = contact_mask(cloth[window], height, self.config.near_height_m)
        view = ClothView(
            rgb=self.view.rectify(rgb, window),
            cloth=cloth[window],
            contact=contact[window],
            height=height,
            mm_per_px=grid.mm_per_px,
        )
        out_of_view = cut_by_image or touches_border(near)
        return _Seen(cloth=cloth, contact=contact, view=view, free_edge_m=lowest, out_of_view=out_of_view)

    def _cloth_height(self, cloth: BoolArray, depth: FloatArray) -> tuple[NDArray[np.float32], bool]:
        """(H, W) m smoothed height of the cloth in the camera's image; and whether low cloth touches its border."""
        height = np.zeros(cloth.shape, dtype=np.float32)
        window = bounding_window(cloth, margin=2)
        if window is None:
            self.camera.height_above_table(depth, (slice(0), slice(0)))  # the shape is checked even so
            return height, False
        part = cloth[window]
        height[window] = smooth_height(self.camera.height_above_table(depth, window), part, self.config.smoothing_px)
        near = np.zeros_like(cloth)
        near[window] = contact_mask(part, height[window], self.config.near_height_m)
        return height, touches_border(near)

    def _check(self, rgb: NDArray[np.uint8]) -> None:
        wanted = (self.camera.height, self.camera.width, 3)
        if rgb.shape != wanted or rgb.dtype != np.uint8:
            raise PerceptionError(f"rgb is {rgb.dtype} of shape {rgb.shape}; this camera gives uint8 of {wanted}")


def _frozen(value: ArrayLike, dtype: type[np.generic], shape: tuple[int, ...], name: str) -> NDArray[np.generic]:
    """A read-only view of ``value``; PerceptionError if it has another shape."""
    array = np.asarray(value, dtype=dtype).view()
    if array.shape != shape:
        raise PerceptionError(f"{name} has shape {array.shape}; it must be {shape}")
    array.setflags(write=False)
    return array
