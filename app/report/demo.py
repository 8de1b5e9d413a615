"""report.html: one self-contained page of what a demo did; pictures and films inside, no scripts, no network."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.media import frames
from layflat.app.media.frames import Draw
from layflat.app.report import figures, tables
from layflat.app.report.figures import SubplotSpec, VectorFieldModel
from layflat.app.report.html_assets import film_uri, png_uri, strip_view, template
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.support.atomic_write import write_text
from layflat.app.support.metrics import disturbed_step
from layflat.data.types import FLAT_AREA, Episode, Provenance
from layflat.sim.robots.registry import robot_spec

FRAME_WIDTH = 300
FILM_WIDTH = 480

ROBOT_TITLES: Mapping[str, str] = {
    "hanger": "Hanger robot: one arm, two clips",
    "pickers": "Pickers robot: two free pickers",
}
ROBOT_TEXTS: Mapping[str, str] = {
    "hanger": "A Panda arm holds the cloth by two corners in a clip hanger and moves it in x and z.",
    "pickers": "Two pickers hold one corner each and move it along three axes.",
}
ABOUT = {
    BASELINE: "Baseline: GP on the holder's position alone",
    PROPOSED: "Proposed: GP on position, WORD and contact portion",
    "gp-finish+recovery+steady": "Past the thesis: the same processes until the cloth is flat; folds are lifted",
}

OnProgress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class RobotResults:
    """What there is to show of one robot."""

    robot: str
    cloth: str
    demonstrations: tuple[Episode, ...]
    """Every attempt, failures too; models were trained on those of outcome "success"."""
    models: Mapping[str, VectorFieldModel]
    """Policy name -> model, for the attractor fields."""
    runs: Mapping[str, tuple[Episode, ...]]
    """Policy name -> its episodes, by seed; the first with images is pictured and filmed."""
    draw: Draw = frames.draw_plain
    """Picture of an observation with what perception makes of it (contact, WORD as an arrow)."""


@dataclass(frozen=True, kw_only=True)
class ReportInput:
    """Everything that the page shows."""

    robots: tuple[RobotResults, ...]
    provenance: Provenance
    seed: int
    notes: tuple[str, ...] = field(default_factory=tuple)
    """Sentences for the reader: what fell short, what was cut."""


def write_report(path: Path, content: ReportInput, *, on_progress: OnProgress | None = None) -> None:
    """Write the page, whole or not at all; ``step`` hears a clause for each part that is being made."""
    say = on_progress or (lambda text: None)
    page = template("demo.html.j2").render(
        robots=[_robot_view(results, say) for results in content.robots],
        provenance=content.provenance,
        seed=content.seed,
        notes=content.notes,
        flat_area=FLAT_AREA,
    )
    write_text(path, page)


def pictured_run(runs: Sequence[Episode]) -> Episode | None:
    """The run to show: the first with images, one with a disturbance before one without."""
    with_images = [run for run in runs if frames.has_images(run)]
    disturbed = [run for run in with_images if disturbed_step(run) is not None]
    return next(iter(disturbed + with_images), None)


def _robot_view(results: RobotResults, say: OnProgress) -> dict[str, Any]:
    """All that the template needs of one robot; pictures as data URIs."""
    runs = {name: results.runs[name] for name in tables.order(results.runs) if results.runs[name]}
    all_runs = [run for group in runs.values() for run in group]
    say(f"{results.robot}: curves and fields")
    view: dict[str, Any] = {
        "id": results.robot,
        "title": ROBOT_TITLES[results.robot],
        "text": ROBOT_TEXTS[results.robot],
        "cloth": results.cloth,
        "demonstrations": len(results.demonstrations),
        "demonstrations_flat": tables.flat_count(results.demonstrations),
        "demonstration_seeds": tables.seeds_text(results.demonstrations),
        "seeds": tables.seeds_text(all_runs),
        "cards": _cards(results, runs),
        "placing": tables.placing_table(runs),
        "disturbance": tables.disturbance_table(runs)
        if any(disturbed_step(run) is not None for run in all_runs)
        else None,
        "every_run": tables.seeds_table(runs),
        "curves": png_uri(figures.contact_over_time(runs)) if runs else None,
        "field": _field(results, runs),
        "policies": [_policy_view(name, group, results.draw, say) for name, group in runs.items()],
    }
    return view


def _cards(results: RobotResults, runs: Mapping[str, Sequence[Episode]]) -> list[dict[str, str]]:
    """The few numbers that matter, with the thesis's below."""
    flat, count = tables.flat_count(results.demonstrations), len(results.demonstrations)
    cards = [
        {
            "name": "demonstrations that end flat",
            "value": f"{flat} of {count}",
            "below": f"area above {FLAT_AREA}",
        }
    ]
    for name, group in runs.items():
        placed, gained = tables.placed_contacts(group), tables.gains(group)
        thesis = tables.THESIS_PLACING.get(name)
        if len(placed):
            below = f"thesis {tables.percent(thesis[1])}" if thesis else ""
            cards.append(
                {"name": f"{name}: contact after placing", "value": tables.percent(placed.mean()), "below": below}
            )
        if len(gained):
            theirs = [final - disturbed for _, disturbed, final in tables.THESIS_DISTURBANCE.get(name, ())]
            below = f"thesis {tables.points(min(theirs))} to {tables.points(max(theirs))}" if theirs else ""
            value = f"{tables.points(gained.mean())} points"
            cards.append({"name": f"{name}: regained after disturbance", "value": value, "below": below})
    return cards


def _policy_view(name: str, runs: Sequence[Episode], draw: Draw, say: OnProgress) -> dict[str, Any]:
    """Strips and film of one policy."""
    run = pictured_run(runs)
    view: dict[str, Any] = {"name": name, "about": ABOUT.get(name, "Comparator"), "run": None}
    if run is None:
        return view
    say(f"{run.robot}: pictures of {name}")
    view["run"] = {"seed": run.seed, "disturbance": run.disturbance, "steps": len(run.steps)}
    view["placing"] = strip_view(frames.frame_strip(run, frames.placing_steps(run), draw, FRAME_WIDTH))
    view["disturbance"] = strip_view(frames.frame_strip(run, frames.disturbance_steps(run), draw, FRAME_WIDTH))
    view["film"] = film_uri(frames.video_frames(run, draw, FILM_WIDTH), fps=1.0 / run.step_s)
    return view


def _field(results: RobotResults, runs: Mapping[str, Sequence[Episode]]) -> dict[str, Any] | None:
    """The attractor fields: one per model, and one for a cloth that has been disturbed where a model can see that."""
    learned = [episode for episode in results.demonstrations if episode.outcome == "success" and episode.steps]
    if not results.models or not learned:
        return None
    disturbed = [run.contact()[step_index] for run in _flatten(runs) if (step_index := disturbed_step(run)) is not None]
    panels = []
    for name in tables.order(results.models):
        model = results.models[name]
        panels.append(SubplotSpec(model=model, title=name, held={}))
        if disturbed and "contact" in model.layout.names:
            held = float(np.clip(np.mean(disturbed), 0.0, 1.0))
            title = f"{name}, contact held at {100 * held:.0f} %"
            panels.append(SubplotSpec(model=model, title=title, held={"contact": held}))
    return {
        "image": png_uri(figures.attractor_field(robot_spec(results.robot), panels, learned)),
        "held": any(panel.held for panel in panels),
        "bandwidth_mm": f"{1000 * figures.BANDWIDTH_M:.0f}",
        "who": "picker 1" if results.robot == "pickers" else "the hanger",
    }


def _flatten(runs: Mapping[str, Sequence[Episode]]) -> Iterator[Episode]:
    return (run for group in runs.values() for run in group)
