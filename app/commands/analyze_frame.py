"""`layflat word`: WORD and contact portion of a real camera's frame from two files."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from layflat.app.commands.frame_result import print_results, region_json, result_json, sure_direction
from layflat.app.media.png import write_png
from layflat.app.media.rgbd_io import match_sizes, read_depth, read_mask, read_rgb
from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import write_json
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.cloth.analyze_frame import FrameResult, analyze_frame
from layflat.perception.cloth.pipeline import PerceptionConfig
from layflat.perception.cloth.relief import Wrinkles, measure_relief
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.cloth.wrinkle_regions import wrinkle_regions
from layflat.perception.descriptors.base import Descriptor
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, DESCRIPTORS, make_descriptor
from layflat.perception.errors import ClothRefusedError
from layflat.perception.overlay import draw_cloth_state, draw_refusal, draw_regions


@dataclass(frozen=True, kw_only=True)
class FrameConfig:
    """Settings of one `layflat word` call."""

    rgb: Path
    depth: Path
    json: Path | None = None
    overlay: Path | None = None
    flat_pixels: int | None = None
    """Cloth pixels of the cloth laid flat."""
    intrinsics: str | None = None
    """``FX,FY,CX,CY``, px; a D435's by default."""
    depth_scale: float | None = None
    """Millimetres of one unit of depth; by default 1, of a TIFF with floats 1000."""
    hsv: str | None = None
    """Colour of the cloth, ``H_MIN,H_MAX,S_MIN,V_MIN``."""
    cloth_at: str | None = None
    """``X,Y`` of a pixel on the cloth."""
    mask: Path | None = None
    """PNG that is not black where the cloth is."""
    contact_mm: float | None = None
    regions: bool = False
    """Also find the parts of the cloth whose wrinkles run one way."""
    descriptor: str = DEFAULT_DESCRIPTOR
    seed: int = 0
    """Seed of the pixels and trials of the table fit."""


def analyze_frame_files(config: FrameConfig, *, force: bool) -> FrameResult:
    """Analyze the frame; print the result, and write a JSON file and an overlay if asked for."""
    if sum(option is not None for option in (config.hsv, config.cloth_at, config.mask)) > 1:
        raise UsageError("--hsv, --cloth-at and --mask each say where the cloth is; give one of them")
    _check_outputs(config.json, config.overlay, _inputs(config), force=force)
    descriptor = make_descriptor(validators.one_of("descriptor", config.descriptor, DESCRIPTORS))
    rgb, frame, depth_scale = _see(config)
    relief = measure_relief(frame.camera, frame.depth, frame.cloth_mask)
    wrinkles, regions = relief.wrinkles(), wrinkle_regions(relief) if config.regions else []
    result = result_json(frame, descriptor, wrinkles, assumed=config.intrinsics is None, flat_pixels=config.flat_pixels)
    result |= {"depth_scale_mm": depth_scale, "seed": config.seed}
    if config.regions:
        result["regions"] = [region_json(region, frame.camera) for region in regions]
    if config.overlay is not None:
        picture = _overlay(rgb, frame, descriptor, wrinkles)
        write_png(config.overlay, draw_regions(picture, regions, relief.grid, frame.camera))
    if config.json is not None:
        write_json(config.json, result)
    print_results(result)
    return frame


def _see(config: FrameConfig) -> tuple[NDArray[np.uint8], FrameResult, float]:
    """Return the colour picture (H, W, 3) as it is analyzed, what is seen, and the depth's unit, mm.

    A refusal leaves an overlay.
    """
    color, at, contact_m = parse_hsv(config.hsv), parse_point(config.cloth_at), contact_height(config.contact_mm)
    rgb, (depth, unit_mm) = read_rgb(config.rgb), read_depth(config.depth, config.depth_scale)
    match = match_sizes(config.rgb, rgb, config.depth, depth)
    if at is not None:
        if not (0 <= at[0] < rgb.shape[1] and 0 <= at[1] < rgb.shape[0]):
            raise UsageError(f"point {at[0]},{at[1]} is outside the image, which is {rgb.shape[1]}x{rgb.shape[0]} px")
        at = match.point(at, rgb.shape[0])
    mask = None if config.mask is None else match.mask(_mask_of(config.mask, rgb.shape[:2], match.size))
    rgb = match.color(rgb)
    try:
        frame = analyze_frame(
            rgb,
            match.depth(depth),
            parse_intrinsics(config.intrinsics, *rgb.shape[1::-1]),
            color=color,
            cloth_at=at,
            mask=mask,
            contact_height_m=contact_m,
            flat_pixels=config.flat_pixels,
            rng=np.random.default_rng(config.seed),
        )
    except ClothRefusedError as error:
        if config.overlay is not None:
            write_png(config.overlay, draw_refusal(rgb, error.taken))
        raise
    if match.note:
        frame = replace(frame, warnings=(match.note, *frame.warnings))
    return rgb, frame, unit_mm


def _inputs(config: FrameConfig) -> tuple[Path, ...]:
    return tuple(path for path in (config.rgb, config.depth, config.mask) if path is not None)


def _mask_of(path: Path, *sizes: tuple[int, ...]) -> NDArray[np.bool_]:
    """Read a mask of one of ``sizes`` (H, W)."""
    mask = read_mask(path)
    if mask.shape not in sizes:
        raise UsageError(
            f"{path} is {mask.shape[1]}x{mask.shape[0]} px; the colour picture is {sizes[0][1]}x{sizes[0][0]} px"
        )
    return mask


def contact_height(millimetres: float | None) -> float:
    """Return the contact height, m; the default if none is given."""
    if millimetres is None:
        return PerceptionConfig.contact_height_m
    if not 1 <= millimetres < 1000 * PerceptionConfig.near_height_m:
        raise UsageError(
            f"--contact-mm is {millimetres:g}; it must be at least 1 and "
            f"below {1000 * PerceptionConfig.near_height_m:g}"
        )
    return millimetres / 1000


def parse_hsv(text: str | None) -> HsvRange | None:
    """Parse H_MIN,H_MAX,S_MIN,V_MIN."""
    if text is None:
        return None
    hue_min, hue_max, saturation_min, value_min = _numbers("--hsv", text, "H_MIN,H_MAX,S_MIN,V_MIN")
    if saturation_min == value_min == 0:
        raise UsageError(f"--hsv is {text}; with S_MIN and V_MIN both 0 everything black is cloth: raise one of them")
    return HsvRange(hue_min=hue_min, hue_max=hue_max, saturation_min=saturation_min, value_min=value_min)


def parse_point(text: str | None) -> tuple[int, int] | None:
    """Parse X,Y: column and row."""
    if text is None:
        return None
    x, y = _numbers("--cloth-at", text, "X,Y")
    if max(abs(x), abs(y)) > 1e6:
        raise UsageError(f"--cloth-at is {text}; it must be a pixel of the image, X,Y")
    return round(x), round(y)


def parse_intrinsics(text: str | None, width: int, height: int) -> Intrinsics:
    """Parse FX,FY,CX,CY in pixels; by default the intrinsics of a D435 for this size."""
    if text is None:
        return Intrinsics.d435(width, height)
    fx, fy, cx, cy = _numbers("--intrinsics", text, "FX,FY,CX,CY")
    return Intrinsics(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


def _numbers(option: str, text: str, form: str) -> list[float]:
    """Parse a list of as many finite numbers as ``form`` has."""
    wanted = form.count(",") + 1
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != wanted or not all(math.isfinite(number) for number in numbers):
        raise UsageError(f"{option} is {text!r}; it must be {wanted} numbers with commas, {form}")
    return numbers


def _check_outputs(json: Path | None, overlay: Path | None, inputs: tuple[Path, ...], *, force: bool) -> None:
    """Raise UsageError unless every output can be written and differs from all other files."""
    outputs = [path for path in (json, overlay) if path is not None]
    taken = [path.resolve() for path in inputs]
    for path in outputs:
        if path.resolve() in taken:
            raise UsageError(f"{path} is named twice; inputs and outputs must be different files")
        taken.append(path.resolve())
    for path in outputs:
        validators.writable_file(path, force=force, suffix=".png" if path is overlay else ".json")


def _overlay(
    rgb: NDArray[np.uint8], frame: FrameResult, descriptor: Descriptor, wrinkles: Wrinkles
) -> NDArray[np.uint8]:
    strength = wrinkles.strength if descriptor.name == "word-axial" else descriptor.direction(frame.view).strength
    state = replace(frame.cloth_state, word=sure_direction(descriptor, frame, wrinkles), strength=strength)
    label = "WORD" if descriptor.name == "word" else descriptor.name
    return draw_cloth_state(rgb, state, frame.camera, label=label)
