"""The numbers of docs/how-to/workstation.md: ``python -m layflat.tests.app.workstation.measure FOLDER [SEEDS]``.

Each comparison is made side by side, in turns, since what else the machine does changes from minute to minute.
"""

from __future__ import annotations

import os
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from layflat.app.workstation.session.activities import make_activity
from layflat.app.workstation.session.activity_client import ActivityClient
from layflat.app.workstation.session.requests import PlaceRequest
from layflat.app.workstation.teleop.teleop_input import zero_input
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.window import FRAMES_HZ, Window
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import robot_spec
from layflat.tests.app.workstation.person import Person, headless

AIR, TABLE = range(2, 22), range(42, 66)
"""Steps of the scripted demonstrator in which the towel hangs, and in which most of it lies."""


def quantiles(values: list[float], unit: str = "ms", scale: float = 1000.0) -> str:
    middle, low, high = np.quantile(np.array(values) * scale, [0.5, 0.05, 0.95])
    return f"{middle:.1f} {unit} (5 to 95 %: {low:.1f} to {high:.1f}, n {len(values)})"


def where(step_index: int) -> str:
    return "in the air" if step_index in AIR else "on the table" if step_index in TABLE else ""


def with_window(folder: Path, robot: str, seed: int, speed: str, *, redraw: bool = False) -> dict[str, list[float]]:
    """Measure a placement in the window."""
    found: dict[str, list[float]] = defaultdict(list)
    window = Window(folder, make_activity, start="Place", remember=False)
    try:
        window.context.settings = replace(window.context.settings, robot=robot, model="scripted", speed=speed)
        page = window.page
        assert isinstance(page, PlacePage)
        page.seed = seed
        person, last = Person(window), -1
        page.start()
        person.wait(lambda: person.status.get("steps", 0) >= AIR[0], "the first steps", 60.0)
        cpu, first, began = time.process_time(), person.status["steps"], time.perf_counter()
        while person.state() != "placed":
            if redraw:
                window.viewport.camera = window.viewport.camera.turned(1, 0)
            person.look()
            now, frame = time.perf_counter(), page.frame()
            phase = where(frame.step) if frame is not None else ""
            if phase:
                found[f"frame {phase}"].append(window.frames_s[-1])
                found[f"pitch {phase}"].append(now - began)
            if frame is not None and frame.step != last and frame.input_s:
                last = frame.step
                found[f"step {phase}"].append(frame.work_s)
                found["input"].append(frame.published_s - frame.work_s - frame.input_s)
            began = now
        found["cpu"].append((time.process_time() - cpu) / (person.status["steps"] - first))
        found["frames"].append(float(person.frames))
    finally:
        window.close()
    return found


def without_window(folder: Path, robot: str, seed: int, *, record: bool) -> dict[str, list[float]]:
    """Measure a placement without a window, as fast as possible; recorded or not."""
    found: dict[str, list[float]] = defaultdict(list)
    path = folder / f"{robot}-{seed}-{os.getpid()}.h5"
    request = PlaceRequest(
        sim_config=SimConfig(robot=robot), seed=seed, speed=0.0, session=path if record else None,
        policy=PolicySpec(builtin=SCRIPTED),
    )  # fmt: skip
    client, last = ActivityClient(make_activity), -1
    client.start(request)
    client.request("start")
    while client.alive and client.status.get("state") != "placed":
        client.poll_events()
        client.send_input(zero_input(robot_spec(robot)))
        if client.frame is not None and client.frame.step != last:
            last = client.frame.step
            found[f"step {where(last)}"].append(client.frame.work_s)
            found["all"].append(client.frame.work_s)
        time.sleep(1 / FRAMES_HZ / 4)
    client.request("discard")
    client.end()
    path.unlink(missing_ok=True)
    return found


def main(folder: Path, seeds: int) -> None:
    headless()
    folder.mkdir(parents=True, exist_ok=True)
    print(f"load at the start {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores, {seeds} seeds each")
    for robot in ("hanger", "pickers"):
        real, fast, bare, kept = ([] for _ in range(4))
        for seed in range(seeds):
            real.append(with_window(folder, robot, seed, "real time"))
            fast.append(with_window(folder, robot, seed, "as fast as possible", redraw=True))
            bare.append(without_window(folder, robot, seed, record=False))
            kept.append(without_window(folder, robot, seed, record=True))
        merged = [{key: [v for run in runs for v in run[key]] for key in runs[0]} for runs in (real, fast, bare, kept)]
        report(robot, *merged)
    print(f"load at the end {os.getloadavg()[0]:.1f}")


def report(robot: str, real: dict, fast: dict, bare: dict, kept: dict) -> None:
    print(f"\n{robot}, real time")
    print("  input waits for its step   ", quantiles(real["input"]))
    print("  processor time of the window for a step", quantiles(real["cpu"]))
    for phase in ("in the air", "on the table"):
        print(f"  {phase}: step             ", quantiles(real[f"step {phase}"]))
        print(f"  {phase}: work of a frame  ", quantiles(real[f"frame {phase}"]))
        rate = 1 / np.mean(real[f"pitch {phase}"])
        share = np.mean(real[f"frame {phase}"]) * rate
        print(f"  {phase}: {rate:.1f} frames/s; the window works {100 * share:.1f} % of the time")
        rate = 1 / np.mean(fast[f"pitch {phase}"])
        print(f"  {phase}, full speed, the view turning in every frame: {rate:.1f} frames/s")
        drawn, alone = np.median(fast[f"step {phase}"]), np.median(bare[f"step {phase}"])
        print(f"  {phase}, full speed: step {1000 * drawn:.1f} ms with, {1000 * alone:.1f} ms without the window")
    ratio = np.mean(kept["all"]) / np.mean(bare["all"])
    print(f"  recording adds {100 * (ratio - 1):+.1f} % to a step (n {len(kept['all'])} and {len(bare['all'])})")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 3)
