"""`layflat word`: WORD and contact portion of a real camera's frame, from two files."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.media.rgbd_io import read_depth, read_rgb, same_size
from layflat.app.support import validators
from layflat.app.support.atomic_write import atomic_write
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.metrics import write_json
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.cloth.analyze_frame import FrameResult, analyze_frame
from layflat.perception.cloth.color_calibration import hue_name
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.descriptors.base import Descriptor
from layflat.perception.descriptors.registry import DESCRIPTORS, make_descriptor
from layflat.perception.overlay import draw_cloth_state

MOST_CONTACT = 1.05
"""A contact portion that noise does not explain."""
WIDEST_NAMED = 120.0
"""Degrees; a wider range of hue has no name."""


def analyze_frame_files(
    rgb_path: Path,
    depth_path: Path,
    *,
    json: Path | None,
    overlay: Path | None,
    flat_pixels: int | None,
    intrinsics: str | None,
    depth_scale: float,
    hsv: str | None,
    cloth_at: str | None,
    contact_mm: float | None,
    descriptor_name: str,
    seed: int,
    force: bool,
) -> FrameResult:
    """See the frame; a few lines on stdout, a JSON file and a drawn picture where asked for.

    ``seed`` draws the pixels and trials that the table is found with.
    """
    if hsv is not None and cloth_at is not None:
        raise UsageError("--hsv and --cloth-at both say what colour the cloth has; give one of them")
    color, at = parse_hsv(hsv), parse_point(cloth_at)
    known = make_descriptor(validators.one_of("descriptor", descriptor_name, DESCRIPTORS))
    contact_m = contact_height(contact_mm)
    _check_outputs(json, overlay, (rgb_path, depth_path), force=force)
    rgb, depth = read_rgb(rgb_path), read_depth(depth_path, depth_scale)
    same_size(rgb_path, rgb, depth_path, depth)
    lens = parse_intrinsics(intrinsics, *rgb.shape[1::-1])
    seen = analyze_frame(
        rgb,
        depth,
        lens,
        color=color,
        cloth_at=at,
        contact_height_m=contact_m,
        flat_pixels=flat_pixels,
        rng=np.random.default_rng(seed),
    )
    result = content(seen, known, lens, assumed=intrinsics is None, flat_pixels=flat_pixels)
    result |= {"depth_scale_mm": depth_scale, "seed": seed}
    if overlay is not None:
        _write_picture(overlay, _drawn(rgb, seen, known))
    if json is not None:
        write_json(json, result)
    show(result)
    return seen


def contact_height(millimetres: float | None) -> float:
    """m; the perceiver's own where none is given."""
    if millimetres is None:
        return PerceptionConfig.contact_height_m
    if not 1 <= millimetres < 1000 * PerceptionConfig.near_height_m:
        raise UsageError(
            f"--contact-mm is {millimetres:g}; it must be at least 1 and "
            f"below {1000 * PerceptionConfig.near_height_m:g}"
        )
    return millimetres / 1000


def parse_hsv(text: str | None) -> HsvRange | None:
    """H_MIN,H_MAX,S_MIN,V_MIN."""
    if text is None:
        return None
    hue_min, hue_max, saturation_min, value_min = _numbers("--hsv", text, "H_MIN,H_MAX,S_MIN,V_MIN")
    if saturation_min == value_min == 0:
        raise UsageError(f"--hsv is {text}; with S_MIN and V_MIN both 0 everything black is cloth: raise one of them")
    return HsvRange(hue_min=hue_min, hue_max=hue_max, saturation_min=saturation_min, value_min=value_min)


def parse_point(text: str | None) -> tuple[int, int] | None:
    """X,Y: column and row."""
    if text is None:
        return None
    x, y = _numbers("--cloth-at", text, "X,Y")
    if max(abs(x), abs(y)) > 1e6:
        raise UsageError(f"--cloth-at is {text}; it must be a pixel of the image, X,Y")
    return round(x), round(y)


def parse_intrinsics(text: str | None, width: int, height: int) -> Intrinsics:
    """FX,FY,CX,CY in pixels, or those of a D435 for this size."""
    if text is None:
        return Intrinsics.d435(width, height)
    fx, fy, cx, cy = _numbers("--intrinsics", text, "FX,FY,CX,CY")
    return Intrinsics(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


def _numbers(option: str, text: str, form: str) -> list[float]:
    """The finite numbers of a list, as many as ``form`` has."""
    wanted = form.count(",") + 1
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != wanted or not all(math.isfinite(number) for number in numbers):
        raise UsageError(f"{option} is {text!r}; it must be {wanted} numbers with commas, {form}")
    return numbers


def _check_outputs(json: Path | None, overlay: Path | None, inputs: tuple[Path, ...], *, force: bool) -> None:
    """Every output can be written, and none is an input or another output."""
    taken = [path.resolve() for path in inputs]
    for path in (json, overlay):
        if path is None:
            continue
        if path.resolve() in taken:
            raise UsageError(f"{path} is named twice; inputs and outputs must be different files")
        taken.append(path.resolve())
    if overlay is not None and overlay.suffix.lower() != ".png":
        raise UsageError(f"{overlay} is not a .png file; the overlay is written as .png")
    for path in (json, overlay):
        if path is not None:
            validators.writable_file(path, force=force)


def _drawn(rgb: NDArray[np.uint8], seen: FrameResult, known: Descriptor) -> NDArray[np.uint8]:
    """The frame with the direction that this descriptor gives."""
    direction = known.direction(seen.view)
    shown = replace(seen.cloth_state, word=direction.vector, strength=direction.strength)
    return draw_cloth_state(rgb, shown, seen.camera, label="WORD" if known.name == "word" else known.name)


def _write_picture(path: Path, rgb: NDArray[np.uint8]) -> None:
    with atomic_write(path) as aside:
        if not cv2.imwrite(str(aside), rgb[..., ::-1]):
            raise LayflatError(f"{path} could not be written; is the disc full?")


def content(
    seen: FrameResult, known: Descriptor, lens: Intrinsics, *, assumed: bool, flat_pixels: int | None
) -> dict[str, Any]:
    """The JSON object without its schema number; directions in image axes, x right, y up."""
    cloth_state, plane = seen.cloth_state, seen.plane
    portion = None if math.isnan(cloth_state.contact_portion) else min(1.0, cloth_state.contact_portion)
    direction, axial = known.direction(seen.view), make_descriptor("word-axial").direction(seen.view)
    return {
        "word": _or_none(make_descriptor("word").describe(seen.view)),
        "word_axial": _or_none(axial.vector),
        "coherence": axial.coherence,
        "strength": axial.strength,
        "cloth_pixels": cloth_state.cloth_pixels,
        "contact_pixels": cloth_state.contact_pixels,
        "contact_portion": portion,
        "mm_per_pixel": cloth_state.grid.mm_per_px,
        "descriptor": {
            "name": known.name,
            "vector": known.describe(seen.view),
            "direction": _or_none(direction.vector),
            "coherence": direction.coherence,
            "strength": direction.strength,
        },
        "hsv": {**asdict(seen.config.color), "source": seen.color_source},
        "plane": {
            "normal": plane.normal,
            "distance_mm": 1000 * plane.distance_m,
            "tilt_deg": plane.tilt_deg,
            "rms_mm": 1000 * plane.rms_m,
            "share": plane.inlier_share,
        },
        "intrinsics": {**asdict(lens), "assumed": assumed},
        "contact_mm": 1000 * seen.config.contact_height_m,
        "flat_pixels": flat_pixels,
        "warnings": [*seen.warnings, *_doubts(cloth_state, flat_pixels)],
    }


def _doubts(cloth_state: ClothState, flat_pixels: int | None) -> list[str]:
    """What makes the contact portion doubtful."""
    if flat_pixels is None or cloth_state.contact_portion <= MOST_CONTACT:
        return []
    return [
        f"{cloth_state.contact_pixels} pixels lie on the table, more than {flat_pixels} flat pixels: "
        "were these counted with this cloth?"
    ]


def _or_none(vector: NDArray[np.float64]) -> list[float] | None:
    return [float(value) for value in vector] if vector.any() else None


def show(result: dict[str, Any]) -> None:
    """Print the result on stdout."""
    found, plane, lens = result["descriptor"], result["plane"], result["intrinsics"]
    print(f"WORD        {_degrees(result['word'])}; axial {_degrees(result['word_axial'])}")
    print(f"wrinkles    coherence {result['coherence']:.2f}, strength {result['strength']:.4f}")
    if found["name"] not in ("word", "word-axial"):
        print(f"{found['name']:<11} {_degrees(found['direction'])}; {len(found['vector'])} numbers")
    print(f"contact     {_contact(result)}")
    print(
        f"table       {plane['distance_mm']:.0f} mm below the camera, tilt {plane['tilt_deg']:.1f} deg, "
        f"scatter {plane['rms_mm']:.1f} mm"
    )
    print(f"colour      {_colour(result['hsv'])}")
    numbers = ",".join(f"{lens[name]:g}" for name in ("fx", "fy", "cx", "cy"))
    print(f"intrinsics  {numbers}{', assumed: a D435 of this image size' if lens['assumed'] else ''}")
    for sentence in result["warnings"]:
        print(f"warning     {sentence}")


def _degrees(vector: list[float] | None) -> str:
    """Angle from the image's right, counter-clockwise."""
    return "no direction" if vector is None else f"{math.degrees(math.atan2(vector[1], vector[0])):+.1f} deg"


def _contact(result: dict[str, Any]) -> str:
    counts = f"{result['contact_pixels']} of {result['cloth_pixels']} cloth pixels lie on the table"
    if result["contact_portion"] is None:
        return f"{counts}; for the portion give --flat-pixels, the cloth pixels of a frame of it laid flat"
    return f"{counts}; portion {100 * result['contact_portion']:.1f} % of {result['flat_pixels']} flat pixels"


def _colour(hsv: dict[str, Any]) -> str:
    span = (hsv["hue_max"] - hsv["hue_min"]) % 360.0
    name = hue_name(hsv["hue_min"] + span / 2) if 0 < span < WIDEST_NAMED else "several hues"
    numbers = ",".join(f"{hsv[key]:g}" for key in ("hue_min", "hue_max", "saturation_min", "value_min"))
    return f"{name}, {hsv['source']}: --hsv {numbers}"
