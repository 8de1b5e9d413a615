"""What a page holds inside itself: pictures and films as data URIs, and the templates that it is made with."""

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
from layflat.app.report import figures, tables

JPEG_QUALITY = 84
UNBROKEN = re.compile(
    r"(\[[^\]]*\]|n = \d+|[\u2212+]?[\d.]+ to [\u2212+]?[\d.]+"
    r"|[\u2212+]?[\d.]+ (?:%|mm|points)|[^\s,;()]*\w-\w[^\s,;()]*)"
)
MOODS = {"disturbance": "bad", "disturbed": "bad", "repair": "good"}
"""How a frame of a strip is framed, by what goes on in it."""


def template(name: str) -> jinja2.Template:
    """A template of this program; whatever it is given is escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("layflat.app.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["colours"] = dict(figures.POLICY_COLOURS)
    environment.filters["unbroken"] = unbroken
    environment.globals["colour_of"] = figures.colour_of
    return environment.get_template(name)


def unbroken(text: str) -> Markup:
    """The text, in which no line ends within a name, an interval, a number and its unit, or "n = 20"."""
    parts = UNBROKEN.split(text)  # every second one matched
    pieces = [Markup('<span class="unbroken">{}</span>').format(p) if k % 2 else escape(p) for k, p in enumerate(parts)]
    return Markup("").join(pieces)


def strip_view(frames: Sequence[Frame]) -> list[dict[str, str]]:
    """Frames as the macro ``strip`` wants them."""
    return [
        {
            "uri": jpeg_uri(frame.image),
            "number": str(number),
            "word": frame.word,
            "contact": tables.percent(frame.contact),
            "time": f"{frame.time_s:.1f} s",
            "mood": MOODS.get(frame.word, ""),
        }
        for number, frame in enumerate(frames, start=1)
    ]


def film_uri(frames: Iterator[NDArray[np.uint8]], *, fps: float) -> str:
    with tempfile.TemporaryDirectory(prefix="layflat-") as folder:
        film = Path(folder) / "film.webm"
        write_video(film, frames, fps=fps)
        return _uri("video/webm", film.read_bytes())


def jpeg_uri(image: NDArray[np.uint8]) -> str:
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return _uri("image/jpeg", encoded.tobytes())


def png_uri(content: bytes) -> str:
    return _uri("image/png", content)


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
