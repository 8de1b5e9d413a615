"""The result of `layflat word`: its JSON object, and the lines on stdout."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.analyze_frame import FrameResult
from layflat.perception.cloth.relief import MIN_COHERENCE, MIN_STRENGTH, Wrinkles
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.cloth.wrinkle_regions import WrinkleRegion
from layflat.perception.descriptors.base import Descriptor
from layflat.perception.descriptors.registry import make_descriptor

INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
MAX_CONTACT = 1.05
"""A larger contact portion is not explained by noise."""


def sure_direction(descriptor: Descriptor, frame: FrameResult, wrinkles: Wrinkles) -> NDArray[np.float64]:
    """Return a descriptor's direction (2,) if the relief has one, else zeros; ``word-axial``'s is the relief's own."""
    if not wrinkles.has_direction:
        return np.zeros(2)
    return wrinkles.axis if descriptor.name == "word-axial" else descriptor.direction(frame.view).vector


def region_json(region: WrinkleRegion, camera: PinholeCamera) -> dict[str, Any]:
    """Return one row of the JSON list ``regions``."""
    pixel, _ = camera.project([[*region.place_m, 0.0]])
    return {
        "pixel": [round(float(value), 1) for value in pixel[0]],
        "place_m": [round(float(value), 4) for value in region.place_m],
        "share": region.share,
        "word_axial": _or_none(region.wrinkles.axis),
        "coherence": region.wrinkles.coherence,
        "strength": region.wrinkles.strength,
    }


def result_json(
    frame: FrameResult, descriptor: Descriptor, wrinkles: Wrinkles, *, assumed: bool, flat_pixels: int | None
) -> dict[str, Any]:
    """Return the JSON object without its schema number; directions in image axes, x right, y up."""
    state, plane, camera = frame.cloth_state, frame.plane, frame.camera
    direction = descriptor.direction(frame.view)
    warnings = list(frame.warnings)
    if flat_pixels is not None and state.contact_portion > MAX_CONTACT:
        warnings.append(
            f"{state.contact_pixels} pixels lie on the table, more than {flat_pixels} flat pixels: "
            "were these counted with this cloth?"
        )
    if wrinkles.min_strength > 2 * MIN_STRENGTH:
        warnings.append(
            f"wrinkles below a strength of {wrinkles.min_strength:.2f} are hidden by the depth's noise: "
            "move the camera nearer"
        )
    return {
        "word": _or_none(sure_direction(make_descriptor("word"), frame, wrinkles)),
        "word_axial": _or_none(wrinkles.direction),
        "coherence": wrinkles.coherence,
        "strength": wrinkles.strength,
        "min_strength": wrinkles.min_strength,
        "cloth_pixels": state.cloth_pixels,
        "contact_pixels": state.contact_pixels,
        "contact_portion": None if math.isnan(state.contact_portion) else min(1.0, state.contact_portion),
        "mm_per_pixel": state.grid.mm_per_px,
        "descriptor": {
            "name": descriptor.name,
            "vector": descriptor.describe(frame.view),
            "direction": _or_none(sure_direction(descriptor, frame, wrinkles)),
            "coherence": direction.coherence,
            "strength": direction.strength,
        },
        "hsv": {
            **(asdict(frame.color) if frame.color else dict.fromkeys(asdict(HsvRange()))),
            "source": frame.color_source,
            "name": frame.color_name,
        },
        "plane": {
            "normal": plane.normal,
            "distance_mm": 1000 * plane.distance_m,
            "tilt_deg": plane.tilt_deg,
            "rms_mm": 1000 * plane.rms_m,
            "share": plane.inlier_share,
        },
        "intrinsics": {name: getattr(camera, name) for name in INTRINSICS} | {"assumed": assumed},
        "contact_mm": 1000 * frame.config.contact_height_m,
        "flat_pixels": flat_pixels,
        "warnings": warnings,
    }


def _or_none(vector: NDArray[np.float64]) -> list[float] | None:
    return [float(value) for value in vector] if vector.any() else None


def print_results(result: dict[str, Any]) -> None:
    """Print the result on stdout."""
    found, plane, intrinsics = result["descriptor"], result["plane"], result["intrinsics"]
    print(f"WORD        {_degrees(result['word'])}; axial {_degrees(result['word_axial'])}")
    print(f"wrinkles    {_wrinkles(result)}")
    for number, region in enumerate(result.get("regions", ()), 1):
        x, y = region["pixel"]
        print(
            f"region {number:<5}{_degrees(region['word_axial'])} at {x:.0f},{y:.0f}: {100 * region['share']:.0f} % of "
            f"the cloth, coherence {region['coherence']:.2f}, strength {region['strength']:.2f}"
        )
    if found["name"] not in ("word", "word-axial"):
        print(f"{found['name']:<11} {_degrees(found['direction'])}; {len(found['vector'])} numbers")
    print(f"contact     {_contact(result)}")
    print(
        f"table       {plane['distance_mm']:.0f} mm below the camera, tilt {plane['tilt_deg']:.1f} deg, "
        f"scatter {plane['rms_mm']:.1f} mm"
    )
    print(f"colour      {_color(result['hsv'])}")
    numbers = ",".join(f"{intrinsics[name]:g}" for name in INTRINSICS[2:])
    print(f"intrinsics  {numbers}{', assumed: a D435 of this image size' if intrinsics['assumed'] else ''}")
    for sentence in result["warnings"]:
        print(f"warning     {sentence}")


def _degrees(vector: list[float] | None) -> str:
    """Return the angle from the image's right, counter-clockwise."""
    return "no direction" if vector is None else f"{math.degrees(math.atan2(vector[1], vector[0])):+.1f} deg"


def _wrinkles(result: dict[str, Any]) -> str:
    """Return how wrinkled the cloth is, and why it has no direction if it has none."""
    numbers = f"strength {result['strength']:.2f}, coherence {result['coherence']:.2f}"
    if result["word_axial"] is not None:
        return numbers
    if result["strength"] < result["min_strength"]:
        return f"strength {result['strength']:.2f}, below {result['min_strength']:.2f}: flat, as far as the depth shows"
    if result["coherence"] < MIN_COHERENCE:
        hint = "" if "regions" in result else "; --regions gives those of its parts"
        return f"{numbers}: they run several ways{hint}"
    return f"{numbers}: what lies on the table is flat"


def _contact(result: dict[str, Any]) -> str:
    counts = f"{result['contact_pixels']} of {result['cloth_pixels']} cloth pixels lie on the table"
    if result["contact_portion"] is None:
        return f"{counts}; for the portion give --flat-pixels, the cloth pixels of a frame of it laid flat"
    return f"{counts}; portion {100 * result['contact_portion']:.1f} % of {result['flat_pixels']} flat pixels"


def _color(hsv: dict[str, Any]) -> str:
    keys = ("hue_min", "hue_max", "saturation_min", "value_min")
    if hsv["hue_min"] is None:
        return f"{hsv['name']}, {hsv['source']}"
    return f"{hsv['name']}, {hsv['source']}: --hsv {','.join(f'{hsv[key]:g}' for key in keys)}"
