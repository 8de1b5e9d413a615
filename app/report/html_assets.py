"""Parts of a self-contained page: its template, and pictures and videos as data URIs."""

from __future__ import annotations

import base64
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import jinja2
import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from layflat.app.media.frames import Frame
from layflat.app.media.video import write_video
from layflat.app.report.charts import policy_keys
from layflat.app.support.formatting import percent

JPEG_QUALITY = 84
UNBROKEN = re.compile(
    r"(\[[^\]]*\]|n = \d+|[\u2212+]?[\d.]+ to [\u2212+]?[\d.]+"
    r"|[\u2212+]?[\d.]+ (?:%|mm|points)|[^\s,;()]*\w-\w[^\s,;()]*)"
)
FRAME_CLASSES = {"disturbance": "bad", "disturbed": "bad", "repair": "good"}
"""CSS class of a frame by its label."""


def page_template() -> jinja2.Template:
    """Return the page's template, which escapes the values that it is given."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("layflat.app.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["no_wrap"] = no_wrap
    environment.globals["policy_key"] = lambda policy: Markup(policy_keys([policy])[0].svg)
    return environment.get_template("page.html.j2")


def no_wrap(text: str) -> Markup:
    """Keep names, intervals, numbers with their units and "n = 20" on one line."""
    parts = UNBROKEN.split(text)  # every second one matched
    pieces = [Markup('<span class="unbroken">{}</span>').format(p) if k % 2 else escape(p) for k, p in enumerate(parts)]
    return Markup("").join(pieces)


def frame_views(frames: Sequence[Frame]) -> list[dict[str, str]]:
    """Return the frames for the template's macro ``strip``."""
    return [
        {
            "uri": jpeg_uri(frame.image),
            "number": str(number),
            "label": frame.label,
            "contact": percent(frame.contact),
            "time": f"{frame.time_s:.1f} s",
            "kind": FRAME_CLASSES.get(frame.label, ""),
        }
        for number, frame in enumerate(frames, start=1)
    ]


def video_uri(frames: Iterator[NDArray[np.uint8]], *, fps: float) -> str:
    """Encode a video as a data URI."""
    with tempfile.TemporaryDirectory(prefix="layflat-") as folder:
        path = Path(folder) / "video.webm"
        write_video(path, frames, fps=fps)
        return _uri("video/webm", path.read_bytes())


def jpeg_uri(image: NDArray[np.uint8]) -> str:
    """Encode an RGB image as the data URI of a JPEG."""
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return _uri("image/jpeg", encoded.tobytes())


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
