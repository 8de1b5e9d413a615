"""README.md of a LeRobot data set: the card that people and Hugging Face read."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from layflat.data.exchange.lerobot_features import ACTION_TEXT, DEPTH_KEY, Feature
from layflat.data.exchange.lerobot_tables import OWN_COLUMNS
from layflat.data.provenance import capture_provenance

CARD = "README.md"
_CARD = """\
---
license: {licence}
task_categories:
- robotics
tags:
- LeRobot
- layflat
- cloth
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# {title}

{summary} LeRobot data set v3.0, {fps} frames per second, made by Layflat {version} on {created}:

```sh
{command}
```

| | |
|---|---|
{facts}

## Columns
A frame is what was seen before a step, and the action that followed. Positions are in the world frame: z up, table top
at z = 0, x to the robot's front, y to its left. Ground truth of the simulator is not in this data set.

| column | type | holds |
|---|---|---|
{columns}

`action` is a {action}; values are cut off at -1 and 1. `meta/info.json` has units and limits under `info` of each
feature. `meta/episodes` has {own} of each episode besides LeRobot's own columns.
{depth}
## Camera
{camera}

## Splits
`train` has all episodes. Reset the environment with other seeds than those in `meta/episodes` to evaluate a policy.

## Licence
{licence_text}
"""
_DEPTH = """
`{key}` is a camera image with one channel. LeRobot's ACT and Diffusion expect three channels of each camera and fail
at this column: remove it first (`lerobot-edit-dataset --operation.type remove_feature`), or export without `--depth`.
"""


def card(
    features: Sequence[Feature],
    episodes: Sequence[Mapping[str, Any]],
    camera: Mapping[str, Any],
    *,
    fps: int,
    trim_idle: bool,
    licence: str,
) -> str:
    """Return the card of a data set with these rows of meta/episodes; ``camera`` is empty where it is not known."""
    made = capture_provenance()
    successes = sum(row["success"] for row in episodes)
    frames = sum(row["length"] for row in episodes)
    robots = _counted(row["robot"] for row in episodes)
    facts = {
        "robot": robots,
        **{
            key: _counted(row[key] for row in episodes) for key in ("task", "cloth", "physics", "source", "disturbance")
        },
        "task texts": _counted(text for row in episodes for text in row["tasks"]),
        "episodes": f"{len(episodes)}, {successes} of them successes",
        "frames": f"{frames}" + (", without idle ends but for one step" if trim_idle else ""),
        "exported with": ", ".join(f"{name} {version}" for name, version in made.versions.items()),
    }
    return _CARD.format(
        licence=json.dumps(licence),
        title=f"Layflat: {_names(row['task'] for row in episodes)} {_names(row['cloth'] for row in episodes)}",
        summary=f"{len(episodes)} episodes in which a robot ({robots}) handles a cloth.",
        fps=fps,
        version=made.versions.get("layflat", "(not installed)"),
        created=made.created_utc,
        command=made.command,
        facts="\n".join(f"| {key} | {_cell(value)} |" for key, value in facts.items()),
        columns="\n".join(_row(feature) for feature in features),
        action=ACTION_TEXT,
        own=", ".join(f"`{key}`" for key in (*OWN_COLUMNS, "camera")),
        depth=_DEPTH.format(key=DEPTH_KEY) if any(feature.key == DEPTH_KEY for feature in features) else "",
        camera=_camera_text(camera),
        licence_text=("Not stated; set it with `--license` of the export." if licence == "unknown" else f"{licence}"),
    )


def _row(feature: Feature) -> str:
    names = "" if feature.names is None or feature.dtype == "image" else f" ({', '.join(feature.names)})"
    shape = "" if feature.shape == (1,) else f" {'x'.join(str(length) for length in feature.shape)}"
    return f"| `{feature.key}` | {feature.dtype}{shape} | {_cell((feature.text or 'as LeRobot counts') + names)} |"


def _camera_text(camera: Mapping[str, Any]) -> str:
    if not camera:
        return "Not one camera for all episodes, or not recorded; column `camera` of `meta/episodes` has what is known."
    shown = "\n".join(f"| {key} | `{json.dumps(value)}` |" for key, value in camera.items())
    return f"Intrinsics in pixels, pose in metres.\n\n| | |\n|---|---|\n{shown}"


def _counted(values: Any) -> str:
    counts = Counter(values)
    return str(next(iter(counts))) if len(counts) == 1 else ", ".join(f"{value} ({n})" for value, n in counts.items())


def _names(values: Any) -> str:
    return " and ".join(dict.fromkeys(values))


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
