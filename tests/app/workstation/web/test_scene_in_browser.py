"""The scene in a real browser: what the pixels show, what the mouse pulls, and what a foreign page gets."""

from __future__ import annotations

import functools
import http.server
import io
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

for needed in ("viser", "playwright.sync_api", "PIL.Image"):
    pytest.importorskip(needed)

import viser  # noqa: E402
from PIL import Image  # noqa: E402
from playwright import sync_api  # noqa: E402

from layflat.app.media import cloth_colors as colors  # noqa: E402
from layflat.app.workstation.preview import initial_frame  # noqa: E402
from layflat.app.workstation.web.scene import Scene  # noqa: E402
from layflat.app.workstation.web.security import SafeServer, open_server  # noqa: E402
from layflat.app.workstation.web.stage import CENTRE, FIELD_RAD, VIEWS, add_stage, look_from  # noqa: E402
from layflat.sim.cloth.registry import cloth_spec  # noqa: E402

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = (900, 560)
WAIT_S = 30.0

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not CHROMIUM.exists(), reason="there is no Chromium")]


@pytest.fixture(scope="module")
def served() -> Iterator[SafeServer]:
    safe = open_server("127.0.0.1", 0)
    add_stage(safe.server)
    yield safe
    safe.server.stop()


@pytest.fixture(scope="module")
def page(served: SafeServer) -> Iterator[Any]:
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
        opened = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        opened.goto(served.address + "?fixedDpr=1")
        wait_for(lambda: served.server.get_clients(), opened)
        opened.add_style_tag(content=".mantine-Paper-root, .mantine-Notification-root {display: none !important}")
        yield opened
        browser.close()


def wait_for(condition: Any, page: Any) -> None:
    limit = time.monotonic() + WAIT_S
    while not condition() and time.monotonic() < limit:
        page.wait_for_timeout(100)
    assert condition()


def pixel_of(point: np.ndarray, view: str) -> tuple[float, float]:
    """Where a point is seen from one of the views."""
    eye = np.array(VIEWS[view])
    back = (eye - CENTRE) / np.linalg.norm(eye - CENTRE)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    away = point - eye
    scale = SIZE[1] / 2 / np.tan(FIELD_RAD / 2) / -(away @ back)
    return SIZE[0] / 2 + scale * (away @ right), SIZE[1] / 2 - scale * (away @ np.cross(back, right))


def seen(page: Any) -> np.ndarray:
    page.wait_for_timeout(2500)
    return np.array(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=float)


def around(picture: np.ndarray, point: np.ndarray, view: str) -> np.ndarray:
    """Median color of the 3 x 3 pixels where a point is seen."""
    x, y = (round(value) for value in pixel_of(point, view))
    return np.median(picture[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3), axis=0)


def show(served: SafeServer, frame: Any, view: str) -> Scene:
    scene = Scene(served.server.scene)
    scene.show(frame)
    for client in served.server.get_clients().values():
        look_from(client, view)
    return scene


def test_holder_and_cloth_are_seen_against_the_table(served: SafeServer, page: Any) -> None:
    frame = initial_frame("pickers", "towel")
    scene = show(served, frame, "Reset")
    try:
        picture = seen(page)
        table = around(picture, np.array([0.55, -0.25, 0.0]), "Reset")
        assert colors.contrast(around(picture, frame.corners[1], "Reset"), table) >= 3.0
        assert colors.contrast(around(picture, frame.nodes[6 * 13 + 6], "Reset"), table) >= 3.0
        lying = replace(frame, nodes=cloth_spec(frame.cloth).flat_nodes(), step=5)
        scene.show(lying)
        resting = around(seen(page), lying.nodes[6 * 13 + 6] + [0.007, 0.007, 0.0], "Reset")
        assert resting.max() < 0.75 * 255  # Shaded: the face would be nearly white.
        assert colors.contrast(resting, table) > 1.5
    finally:
        scene.remove()


def test_the_mouse_pulls_the_cloth_and_not_the_camera(served: SafeServer, page: Any) -> None:
    frame = initial_frame("hanger", "towel")
    scene = show(served, frame, "Reset")
    heard: list[Any] = []
    scene.let_drag(lambda _, drag: heard.append(drag))
    try:
        page.wait_for_timeout(2500)
        node = 3 * 13 + 8
        x, y = pixel_of(frame.nodes[node], "Reset")
        page.mouse.move(x, y)
        page.wait_for_timeout(500)
        page.mouse.down()
        for k in range(1, 9):
            page.mouse.move(x + 6 * k, y - 4 * k)
            page.wait_for_timeout(120)
        page.mouse.up()
        wait_for(lambda: heard and heard[-1] is None, page)
        pulls = [drag for drag in heard if drag is not None]
        assert {drag.node for drag in pulls} == {node}
        # To the right and up as seen from the camera, which has not moved.
        expected = np.array(pixel_of(np.array(pulls[-1].target_m), "Reset")) - (x, y)
        np.testing.assert_allclose(expected, (48, -32), atol=14)
    finally:
        scene.remove()


def test_a_page_of_another_origin_cannot_connect(served: SafeServer, page: Any, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("<p>a page of somebody else</p>")
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        foreign = page.context.browser.new_page()
        foreign.goto(f"http://127.0.0.1:{other.server_address[1]}/")
        tried = """([address, protocol]) => new Promise(done => {
          const socket = new WebSocket(address.replace("http", "ws"), [protocol]);
          socket.onopen = () => done("open");
          socket.onerror = () => done("refused");
        })"""
        to = [served.address, f"viser-v{viser.__version__}"]
        assert page.evaluate(tried, to) == "open"
        assert foreign.evaluate(tried, to) == "refused"
        foreign.close()
        other.shutdown()
