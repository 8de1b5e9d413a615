"""Thumbnails: how the cloth lies at the end of an episode, as a small picture."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.data.format import schema
from layflat.data.session.reader import Session
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.camera.renderer import Renderer
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.registry import CLOTHS, cloth_spec

SIZE_PX = (96, 72)
_KNOWN: dict[tuple[str, str], bytes] = {}
"""JPEG by identity and content of the recording."""


def thumbnail(session: Session, name: str) -> bytes:
    """Return a JPEG of the final cloth; empty where it was not recorded or is unknown."""
    key = session.info(name).uid, session.contents([name])[name]
    if key not in _KNOWN:
        _KNOWN[key] = _draw(session, name)
    return _KNOWN[key]


def _draw(session: Session, name: str) -> bytes:
    if session.info(name).flat_area_final is None or session.cloth not in CLOTHS:
        return b""
    nodes = session.array(name, schema.FINAL_STATE).reshape(-1, 3)
    if len(nodes) != cloth_spec(session.cloth).n_nodes:
        return b""
    renderer, camera = _renderer(), _renderer().pinhole
    picture = renderer.background()
    renderer.draw_cloth(picture, _maker(session.cloth).mesh(nodes))
    image: NDArray[np.uint8] = picture.rgb.reshape(camera.height, camera.width, 3)
    small = cv2.resize(image, SIZE_PX, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR))[1].tobytes())


@lru_cache(maxsize=1)
def _renderer() -> Renderer:
    return Renderer(default_pinhole())


@lru_cache(maxsize=4)
def _maker(cloth: str) -> MeshMaker:
    return MeshMaker(cloth_spec(cloth))
