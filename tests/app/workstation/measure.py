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

from layflat.app.workstation.session.bench_client import BenchClient
from layflat.app.workstation.session.tasks import make_task
from layflat.app.workstation.teleop.teleop_input import zero_input
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.settings import Settings
from layflat.app.workstation.window.window import FRAMES_HZ, Window
from layflat.tests.app.workstation.person import Person, headless

AIR, TABLE = range(2, 22), range(42, 66)
"""Steps of the scripted demonstrator in which the towel hangs, and in which most of it lies."""


def told(values: list[float], unit: str = "ms", scale: float = 1000.0) -> str:
    middle, low, high = np.quantile(np.array(values) * scale, [0.5, 0.05, 0.95])
    return f"{middle:.1f} {unit} (5 to 95 %: {low:.1f} to {high:.1f}, n {len(values)})"


def where(step_index: int) -> str:
    return "in the air" if step_index in AIR else "on the table" if step_index in TABLE else ""


def with_window(folder: Path, robot: str, seed: int, speed: str, *, redraw: bool = False) -> dict[str, list[float]]:
    """One placing watched in the window."""
    found: dict[str, list[float]] = defaultdict(list)
    window = Window(folder, make_task, start="Place", remember=False)
    try:
        window.shop.settings = replace(window.shop.settings, robot=robot, model="scripted", speed=speed)
        mode = window.mode
        assert isinstance(mode, PlacePage)
        mode.seed = seed
        person, last = Person(window), -1
        mode.start()
        person.wait(lambda: person.status.get("steps", 0) >= AIR[0], "the first steps", 60.0)
        cpu, first, began = time.process_time(), person.status["steps"], time.perf_counter()
        while person.state() != "placed":
            if redraw:
                window.pane.orbit = window.pane.orbit.turned(1, 0)
            person.look()
            now, moment = time.perf_counter(), mode.moment()
            phase = where(moment.step) if moment is not None else ""
            if phase:
                found[f"frame {phase}"].append(window.frames_s[-1])
                found[f"pitch {phase}"].append(now - began)
            if moment is not None and moment.step != last and moment.input_s:
                last = moment.step
                found[f"step {phase}"].append(moment.work_s)
                found["input"].append(moment.told_s - moment.work_s - moment.input_s)
            began = now
        found["cpu"].append((time.process_time() - cpu) / (person.status["steps"] - first))
        found["frames"].append(float(person.frames))
    finally:
        window.close()
    return found


def without_window(folder: Path, robot: str, seed: int, *, record: bool) -> dict[str, list[float]]:
    """One placing that nobody draws, as fast as it goes; recorded or not."""
    found: dict[str, list[float]] = defaultdict(list)
    path = folder / f"{robot}-{seed}-{os.getpid()}.h5"
    settings = Settings(robot=robot, speed="as fast as it goes")
    order = {"work": "place", **settings.bench(), "seed": seed, "policy": "scripted", "hurry": False}
    link, last = BenchClient(make_task), -1
    link.start(order | ({"record": str(path)} if record else {}), robot)
    link.ask("start")
    while link.alive and link.status.get("state") != "placed":
        link.hear()
        link.put(zero_input(robot))
        if link.moment is not None and link.moment.step != last:
            last = link.moment.step
            found[f"step {where(last)}"].append(link.moment.work_s)
            found["all"].append(link.moment.work_s)
        time.sleep(1 / FRAMES_HZ / 4)
    link.ask("discard")
    link.end()
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
            fast.append(with_window(folder, robot, seed, "as fast as it goes", redraw=True))
            bare.append(without_window(folder, robot, seed, record=False))
            kept.append(without_window(folder, robot, seed, record=True))
        merged = [{key: [v for run in runs for v in run[key]] for key in runs[0]} for runs in (real, fast, bare, kept)]
        report(robot, *merged)
    print(f"load at the end {os.getloadavg()[0]:.1f}")


def report(robot: str, real: dict, fast: dict, bare: dict, kept: dict) -> None:
    print(f"\n{robot}, real time")
    print("  input waits for its step   ", told(real["input"]))
    print("  processor time of the window for a step", told(real["cpu"]))
    for phase in ("in the air", "on the table"):
        print(f"  {phase}: step             ", told(real[f"step {phase}"]))
        print(f"  {phase}: work of a frame  ", told(real[f"frame {phase}"]))
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
