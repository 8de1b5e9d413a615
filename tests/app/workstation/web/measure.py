"""The browser's numbers in docs/explanation/results/speed.md.

``python -m layflat.tests.app.workstation.web.measure [SEEDS]`` places the towel with the scripted policy, shown to none,
one and three viewers in turns, since what else the machine does changes from minute to minute. A viewer is a websocket
client in a process of its own that reads all; with playwright there is a headless Chromium, too. Each frame is marked:
with a text that the client finds in what arrives, and with a color that is read back from the page's pixels.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.pages.registry import PAGES
from layflat.app.workstation.web.server import AppConfig, serve
from layflat.app.workstation.web.viewer import Viewer
from layflat.app.workstation.web.workstation import Workstation
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.config import SimConfig

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
MARKS = ((255, 0, 0), (0, 255, 0), (0, 0, 255))
FIRST, LAST = 5, 65
"""Steps that count: the towel hangs, is laid, and lies."""
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
    import zstandard
    from viser import _messages
    from websockets.sync.client import connect

    import viser

    seen, total, began = [], 0, time.monotonic()
    with connect(
        address.replace("http", "ws"), subprotocols=[f"viser-v{viser.__version__}"], max_size=None  # type: ignore[list-item]
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
        page = browser.new_page(viewport={"width": 1000, "height": 640})
        page.add_init_script(KEEP_PIXELS)
        page.goto(address)
        page.wait_for_selector("canvas")
        page.evaluate(READ_MARKS)
        sys.stdin.read()
        print(json.dumps({"marks": page.evaluate("window.marks")}))
        browser.close()


def place(seed: int, kinds: list[str], *, speed: float = 1.0) -> dict[str, Any]:
    """Measure one placement with these viewers: "watch" or "watch_in_chromium"."""
    folder = Path(tempfile.mkdtemp())
    workstation = Workstation(Folder(folder), lambda shared, client: MarkedViewer(shared, client, PAGES))
    with serve(workstation, AppConfig(folder=folder, port=0, open_browser=False)) as address:
        command = [sys.executable, "-m", "layflat.tests.app.workstation.web.measure"]
        watchers = [
            subprocess.Popen([*command, kind, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            for kind in kinds
        ]
        limit = time.monotonic() + 60.0
        while len(workstation.viewers) < len(kinds) and time.monotonic() < limit:
            workstation.round()
        until = time.monotonic() + (8.0 if "watch_in_chromium" in kinds else 1.0)
        while time.monotonic() < until:
            workstation.round()
        config = SimConfig(robot="hanger")
        workstation.start(SessionRequest(sim_config=config, policy=PolicySpec(builtin=SCRIPTED), seed=seed, speed=speed))
        for viewer in workstation.viewers.values():
            viewer.open("Place")
        frames, cpu = _run(workstation)
        # The browser says what it saw while the server still runs.
        said = []
        for watcher in [one for one, kind in zip(watchers, kinds, strict=True) if kind == "watch_in_chromium"]:
            assert watcher.stdin is not None
            watcher.stdin.close()
            while watcher.poll() is None:
                workstation.round()
            assert watcher.stdout is not None
            said.append(json.loads(watcher.stdout.read()))
    for watcher in watchers:
        if watcher.poll() is None:
            assert watcher.stdout is not None
            said.append(json.loads(watcher.stdout.read()))
            watcher.wait()
    return {"frames": frames, "cpu": cpu, "said": said}


def _run(workstation: Workstation) -> tuple[list[Any], float]:
    """Do rounds until LAST; return step, published time and work of each frame, and the server's CPU s for a step."""
    frames: list[Any] = []
    cpu = 0.0
    limit = time.monotonic() + 90.0
    while (not frames or frames[-1][0] < LAST) and time.monotonic() < limit:
        workstation.round()
        frame = workstation.session.frame
        if frame is not None and frame.step >= FIRST and (not frames or frame.step != frames[-1][0]):
            cpu = cpu or time.process_time()
            frames.append((frame.step, frame.published_s, frame.work_s))
    return frames, (time.process_time() - cpu) / max(frames[-1][0] - frames[0][0], 1)


def pixel_delays(result: dict[str, Any]) -> list[float]:
    """Return the ms from the publishing of each frame to its color on the page."""
    offset = 1000 * (time.time() - time.monotonic())
    published = {step: 1000 * at_s + offset for step, at_s, _ in result["frames"]}
    delays = []
    for said in result["said"]:
        for mark, at_ms in said.get("marks", []):
            past = [at_ms - at for step, at in published.items() if step % 3 == mark and 0 <= at_ms - at < 280]
            delays += past[-1:]
    return delays


def main(seeds: int) -> None:
    has_browser = CHROMIUM.exists()
    with suppress(ImportError):
        import playwright  # noqa: F401
    has_browser = has_browser and "playwright" in sys.modules
    cases = {"no viewer": [], "one viewer": ["watch"], "three viewers": ["watch"] * 3}
    if has_browser:
        cases["Chromium"] = ["watch_in_chromium"]
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in cases}
    for seed in range(seeds):
        for name, kinds in cases.items():
            found[name].append(place(seed, kinds))
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    for name, results in found.items():
        step_ms = [1000 * frame[2] for result in results for frame in result["frames"]]
        cpu = [1000 * result["cpu"] for result in results]
        print(f"{name}: a step works {quantiles(step_ms, 'ms')}; the server {quantiles(cpu, 'ms CPU a step')}")
        shares = [100 * result["cpu"] / np.median([frame[2] for frame in result["frames"]]) for result in results]
        print(f"  {quantiles(shares, '% of a step')}")
        seen = [said["seen"] for result in results for said in result["said"] if "seen" in said]
        if seen:
            delays = [delay for one in seen for step, delay, _, _ in one if FIRST <= step <= LAST]
            rates = [(one[-1][2] - one[0][2]) / max(one[-1][3] - one[0][3], 1e-9) / 1e6 for one in seen]
            print(f"  at the client after {quantiles(delays, 'ms')}; {quantiles(rates, 'MB/s a viewer')}")
        pixels = [delay for result in results for delay in pixel_delays(result)]
        if pixels:
            share = len(pixels) / sum(len(result["frames"]) for result in results)
            print(f"  on the page after {quantiles(pixels, 'ms')}, {100 * share:.0f} % of the frames seen")


if __name__ == "__main__":
    if sys.argv[1:2] == ["watch"]:
        watch(sys.argv[2])
    elif sys.argv[1:2] == ["watch_in_chromium"]:
        watch_in_chromium(sys.argv[2])
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
