"""The browser's numbers in docs/explanation/results/speed.md.

``python -m layflat.tests.app.workstation.web.measure [SEEDS [HZ]]`` simulates placements, and shows their frames on the
page Place to none, one and three viewers in turns, since what else the machine does changes from minute to minute. A
viewer is a websocket client in a process of its own that reads all; with playwright there is a headless Chromium, too.
Each frame is marked: with a text that the client finds in what arrives, and with a color that is read back from the
page's pixels. PICTURE names a file for the browser's last picture.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.workstation.session.frame_channel import SimulationFrame, frame_of
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.pages import PAGES
from layflat.app.workstation.web.server import AppConfig, serve
from layflat.app.workstation.web.viewer import Viewer
from layflat.app.workstation.web.workstation import Workstation
from layflat.policy.runner import EpisodeRunner
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.config import SimConfig
from layflat.sim.simulation import ClothSimulation

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
VIEWPORT: Any = {"width": 900, "height": 500}
"""Small, since pictures are drawn without a GPU here."""
MARKS = ((255, 0, 0), (0, 255, 0), (0, 0, 255))
STEPS = 66
KEEP_PIXELS = """HTMLCanvasElement.prototype.getContext = (make => function (kind, options) {
  return make.call(this, kind, kind.startsWith("webgl") ? {...options, preserveDrawingBuffer: true} : options);
})(HTMLCanvasElement.prototype.getContext)"""
READ_MARKS = """() => {
  const small = document.createElement("canvas"); small.width = 48; small.height = 32;
  const pen = small.getContext("2d", {willReadFrequently: true});
  window.marks = []; let last = -1;
  const look = () => {
    const view = [...document.querySelectorAll("canvas")].sort((a, b) => b.width - a.width)[0];
    pen.drawImage(view, 0, 0, 48, 32);
    const rgba = pen.getImageData(0, 0, 48, 32).data, found = [0, 0, 0];
    for (let i = 0; i < rgba.length; i += 4) for (let k = 0; k < 3; k++)
      if (rgba[i + k] > 90 && rgba[i + (k + 1) % 3] < rgba[i + k] / 3 && rgba[i + (k + 2) % 3] < rgba[i + k] / 3)
        found[k]++;
    const mark = found.indexOf(Math.max(...found));
    if (found[mark] > 20 && mark !== last) {
      last = mark; window.marks.push([mark, performance.timeOrigin + performance.now()]);
    }
    requestAnimationFrame(look);
  };
  look();
}"""


def quantiles(values: Any, unit: str) -> str:
    middle, low, high = np.quantile(np.array(values, dtype=float), [0.5, 0.05, 0.95])
    return f"{middle:.1f} {unit} (5 to 95 %: {low:.1f} to {high:.1f}, n {len(values)})"


class MarkedViewer(Viewer):
    """A viewer whose scene carries the number and the time of each frame."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        scene, show = self.client.scene, self.scene.show
        text = scene.add_label("/mark/text", "", visible=False)
        box = scene.add_box("/mark/box", (0, 0, 0), (0.5, 0.5, 0.05), position=(0.75, -0.55, 0.0))

        def marked(frame: Any) -> None:
            with self.client.atomic():
                text.text = f"{frame.step} {frame.published_s}"
                box.color = MARKS[frame.step % 3]
                show(frame)

        self.scene.show = marked  # type: ignore[method-assign]


def watch(address: str) -> None:
    """Receive everything until the server ends, then print when which frame came."""
    import msgspec
    import viser
    import zstandard
    from viser import _messages
    from websockets.sync.client import connect

    seen, total, began = [], 0, time.monotonic()
    with connect(
        address.replace("http", "ws"),
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,  # type: ignore[list-item]
    ) as socket:
        pose = {"wxyz": (1.0, 0.0, 0.0, 0.0), "position": (1.0, 1.0, 1.0), "look_at": (0.0, 0.0, 0.0)}
        size = {"image_height": 600, "image_width": 900, "fov": 0.7, "near": 0.01, "far": 100.0}
        camera = _messages.ViewerCameraMessage(**pose, **size, up_direction=(0.0, 0.0, 1.0))  # type: ignore[arg-type]
        socket.send(msgspec.msgpack.encode(camera.as_serializable_dict([])))
        with suppress(Exception):
            while True:
                raw = socket.recv()
                now = time.monotonic()
                assert isinstance(raw, bytes)
                total += len(raw)
                size_of = int.from_bytes(raw[8:16], "little")
                messages = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size_of]))
                for message in messages["messages"]:
                    if message.get("name") == "/mark/text" and "text" in message.get("updates", {}):
                        step, published = message["updates"]["text"].split()
                        seen.append((int(step), 1000 * (now - float(published)), total, now))
    print(json.dumps({"seen": seen, "wall_s": time.monotonic() - began}))


def watch_in_chromium(address: str) -> None:
    """Look with a browser, until stdin ends: print when which mark appeared, in ms since 1970."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
        page = browser.new_page(viewport=VIEWPORT)
        page.add_init_script(KEEP_PIXELS)
        page.goto(address)
        page.wait_for_selector("canvas")
        page.evaluate(READ_MARKS)
        sys.stdin.read()
        if "PICTURE" in os.environ:
            page.screenshot(path=os.environ["PICTURE"])
        print(json.dumps({"marks": page.evaluate("window.marks")}))
        browser.close()


def simulate(seed: int) -> tuple[list[SimulationFrame], list[float]]:
    """Return the frames of a scripted placement with the camera on, and the CPU s of each step."""
    sim = ClothSimulation(SimConfig(robot="hanger"))
    costs, frames = [], []
    try:
        sim.reset(seed)
        run = EpisodeRunner(sim, PolicySpec(builtin=SCRIPTED).make(sim), seed=seed, keep_images=False)
        for _ in range(STEPS):
            began = time.process_time()
            run.step("place")
            costs.append(time.process_time() - began)
            frames.append(frame_of(sim, run, input_s=0.0, work_s=0.0))
    finally:
        sim.close()
    return frames, costs


def show(frames: list[SimulationFrame], kinds: list[str], hz: float) -> dict[str, Any]:
    """Show frames at a rate to these viewers, "watch" or "watch_in_chromium", on the page Place."""
    folder = Path(tempfile.mkdtemp())
    workstation = Workstation(Folder(folder), folder, lambda shared, client: MarkedViewer(shared, client, PAGES))
    with serve(workstation, AppConfig(folder=folder, port=0, open_browser=False)) as address:
        command = [sys.executable, "-m", "layflat.tests.app.workstation.web.measure"]
        watchers = [
            subprocess.Popen([*command, kind, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            for kind in kinds
        ]
        rounds(workstation, 60.0, lambda: len(workstation.viewers) == len(kinds))
        for viewer in workstation.viewers.values():
            viewer.open("Place")
        rounds(workstation, 10.0 if "watch_in_chromium" in kinds else 2.0)
        cpu, began, published = time.process_time(), time.monotonic(), []
        for k, frame in enumerate(frames):
            published.append(time.monotonic())
            # As if it had just come from the episode's process.
            workstation.session.frame = replace(frame, published_s=published[-1])
            rounds(workstation, began + (k + 1) / hz - time.monotonic())
        cpu = (time.process_time() - cpu) / len(frames)
        said = []
        for watcher, kind in zip(watchers, kinds, strict=True):
            assert watcher.stdin is not None
            if kind == "watch_in_chromium":  # It tells what it saw while the server still runs.
                watcher.stdin.close()
                rounds(workstation, 60.0, lambda watcher=watcher: watcher.poll() is not None)  # type: ignore[misc]
    for watcher in watchers:
        assert watcher.stdout is not None
        said.append(json.loads(watcher.stdout.read()))
        watcher.wait()
    return {"published": dict(zip([frame.step for frame in frames], published, strict=True)), "cpu": cpu, "said": said}


def rounds(workstation: Workstation, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
    limit = time.monotonic() + seconds
    while time.monotonic() < limit and not until():
        workstation.round()


def pixel_delays(result: dict[str, Any], hz: float) -> list[float]:
    """Return the ms from the publishing of each frame to its color on the page; the colors repeat after three."""
    offset = 1000 * (time.time() - time.monotonic())
    delays = []
    for mark, at_ms in (mark for said in result["said"] for mark in said.get("marks", [])):
        ages = [at_ms - 1000 * at - offset for step, at in result["published"].items() if step % 3 == mark]
        delays += [age for age in ages if 0 <= age < 3000 / hz]
    return delays


def main(seeds: float, hz: float) -> None:
    cases: dict[str, list[str]] = {"no viewer": [], "one viewer": ["watch"], "three viewers": ["watch"] * 3}
    if CHROMIUM.exists() and find_spec("playwright"):
        cases["Chromium"] = ["watch_in_chromium"]
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in cases}
    steps: list[float] = []
    for seed in range(int(seeds)):
        frames, costs = simulate(seed)
        steps += costs
        for name, kinds in cases.items():
            found[name].append(show(frames, kinds, hz))
    step_ms = 1000 * float(np.median(steps))
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores, {hz:g} frames a second")
    print(f"a step costs {quantiles(1000 * np.array(steps), 'ms CPU')}")
    for name, results in found.items():
        cpu = [1000 * result["cpu"] for result in results]
        print(
            f"{name}: the server {quantiles(cpu, 'ms CPU a frame')}: {100 * np.median(cpu) / step_ms:.1f} % of a step"
        )
        seen = [said["seen"] for result in results for said in result["said"] if said.get("seen")]
        if seen:
            rates = [(one[-1][2] - one[0][2]) / (len(one) - 1) / 1e3 for one in seen]
            delays = [delay for one in seen for _, delay, _, _ in one]
            print(f"  at the client after {quantiles(delays, 'ms')}; {quantiles(rates, 'kB a frame')}")
        pixels = [delay for result in results for delay in pixel_delays(result, hz)]
        if pixels:
            share = len(pixels) / sum(len(result["published"]) for result in results)
            print(f"  on the page after {quantiles(pixels, 'ms')}; {100 * share:.0f} % of the frames")


if __name__ == "__main__":
    if sys.argv[1:2] == ["watch"]:
        watch(sys.argv[2])
    elif sys.argv[1:2] == ["watch_in_chromium"]:
        watch_in_chromium(sys.argv[2])
    else:
        main(*[float(text) for text in (sys.argv[1:] + ["2", "10"][len(sys.argv) - 1 :])])
