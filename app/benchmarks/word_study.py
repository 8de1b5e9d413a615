"""How right each descriptor is, by light and sensor: the tables and plots of docs/explanation/results/word.md.

``python -m layflat.app.benchmarks.word_study --out DIR`` draws sheets of known wrinkles as the bench's camera would see
them, spoils the
depth as a D435 does, and holds every descriptor's direction against the wrinkles that were drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import pandas as pd
import typer

from layflat.app.support import validators
from layflat.app.support.atomic_write import atomic_write, write_text
from layflat.app.support.progress import Progress
from layflat.data.arrays import FloatArray
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.descriptors.base import Descriptor
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.perception.descriptors.word import AXIAL_CONFIG, THESIS_CONFIG, WordDescriptor
from layflat.perception.synthetic_sheet import RenderConfig, SyntheticSheet, Wave, render_sheet
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor

ANGLES = 24
"""Directions of the wrinkles, over half a turn."""
PHASES = 2
"""Places of the wrinkles on the sheet for each direction."""
RGB_NOISE = 3.0
SEED = 0
FRAME_S = 0.25
"""Expected wall time of one frame with all descriptors."""

PRINTED_MM = 17.0
"""8 pixels where a 0.35 m cloth is 165 pixels wide, as in a camera of 320x240 (figure 3-1 does not give its scale)."""
LADDER: Mapping[str, WordDescriptor] = {
    "Algorithm 1, kernel of Eq. 3-1 as it stands, lambda 17 mm (8 px)": WordDescriptor(
        config=replace(THESIS_CONFIG, wavelength_mm=PRINTED_MM, zero_mean=False)
    ),
    "the same, lambda 60 mm": WordDescriptor(config=replace(THESIS_CONFIG, zero_mean=False)),
    "`word`: the same, kernel of mean zero": WordDescriptor(),
    "outline filled, edge left out": WordDescriptor(config=replace(THESIS_CONFIG, fill=True, erosion_mm=14.0)),
    "the same responses, mean axis": WordDescriptor(
        config=replace(THESIS_CONFIG, fill=True, erosion_mm=14.0), axial=True
    ),
    "round even kernel": WordDescriptor(
        config=replace(AXIAL_CONFIG, relief=False, max_contrast=math.inf, rms=False), axial=True
    ),
    "relief beside brightness": WordDescriptor(
        config=replace(AXIAL_CONFIG, max_contrast=math.inf, rms=False), axial=True
    ),
    "local contrast, cut": WordDescriptor(config=replace(AXIAL_CONFIG, rms=False), axial=True),
    "`word-axial`: root mean square instead of the sum": WordDescriptor(config=AXIAL_CONFIG, axial=True),
}
"""Each row has all that the rows above it have."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One row: what the sheets and their light are like."""

    group: str
    name: str
    wave: Wave = field(default_factory=lambda: Wave(wavelength_m=0.06))
    """Its normal and phase are varied."""
    across: float | None = None
    """A second wave at this share of the first's amplitude, at right angles."""
    drawing: RenderConfig = field(default_factory=lambda: RenderConfig(rgb_noise=RGB_NOISE))
    depth_noise: float = 1.0
    """Factor on a D435's disparity error."""

    def light(self, **changes: object) -> Condition:
        return replace(self, drawing=replace(self.drawing, light=replace(self.drawing.light, **changes)))  # type: ignore[arg-type]


def conditions() -> Iterator[Condition]:
    """Every row of the tables, in order."""
    usual = Condition(group="usual", name="60 mm, 2 mm, light from 45 degrees at 45 degrees")
    yield usual
    for wavelength in (45, 80, 100):
        yield replace(usual, group="wrinkles", name=f"{wavelength} mm long", wave=Wave(wavelength_m=wavelength / 1000))
    for amplitude in (1.0, 3.0):
        wave = Wave(wavelength_m=0.06, amplitude_m=amplitude / 1000)
        yield replace(usual, group="wrinkles", name=f"{amplitude:g} mm high", wave=wave)
    yield replace(usual, group="wrinkles", name="others across them, half as high", across=0.5)
    for elevation in (15, 30, 45, 60, 75):
        for azimuth in range(0, 360, 45):
            name = f"from {azimuth} degrees, {elevation} degrees high"
            yield replace(usual, group="light", name=name).light(azimuth_deg=azimuth, elevation_deg=elevation)
    yield replace(usual, group="light", name="straight above").light(elevation_deg=90)
    yield replace(usual, group="light", name="room light only").light(ambient=1.0)
    for exposure in (0.25, 0.5, 1.3, 1.8):
        yield replace(usual, group="exposure", name=f"{exposure:g} times").light(exposure=exposure)
    yield replace(usual, group="shadow", name="half of the cloth in shadow").light(shaded_from_m=0.0)
    yield replace(usual, group="shadow", name="low light, crests throw shadows").light(elevation_deg=8)
    for noise in (0.0, 0.5, 2.0, 3.0):
        yield replace(usual, group="depth noise", name=f"{noise:g} times a D435's", depth_noise=noise)
    yield replace(usual, group="depth noise", name="10 % missing", drawing=replace(usual.drawing, missing=0.10))
    for name, tint in (("red lamp", (1.3, 1.0, 0.8)), ("blue lamp", (0.8, 1.0, 1.2)), ("green cast", (0.9, 1.25, 0.9))):
        yield replace(usual, group="colour", name=name).light(tint=tint)


def sheets(condition: Condition, phases: int = PHASES) -> Iterator[tuple[float, SyntheticSheet, int]]:
    """Angle of the wrinkles' perpendicular, rad; the sheet; a seed of its own."""
    for k in range(ANGLES * phases):
        normal = -math.pi / 2 + math.pi * (k // phases) / ANGLES
        rng = np.random.default_rng([SEED, k])
        wave = replace(condition.wave, normal=normal, phase=float(rng.uniform(0, 2 * math.pi)))
        waves = [wave]
        if condition.across is not None:
            smaller = condition.across * wave.amplitude_m
            phase = float(rng.uniform(0, 2 * math.pi))
            waves.append(replace(wave, normal=normal + math.pi / 2, amplitude_m=smaller, phase=phase))
        centre = (float(rng.uniform(0.2, 0.3)), float(rng.uniform(-0.03, 0.03)))
        yield normal, SyntheticSheet(waves=tuple(waves), centre=centre), k


class SyntheticCamera:
    """The bench's camera over drawn sheets."""

    def __init__(self) -> None:
        self.camera = default_pinhole()
        self.perceiver = PerceptionPipeline(self.camera)

    def view(self, sheet: SyntheticSheet, condition: Condition, seed: int) -> ClothView | None:
        drawn = render_sheet(self.camera, sheet, replace(condition.drawing, seed=seed))
        depth = drawn.depth
        if condition.depth_noise > 0:
            noise = replace(DepthNoise(), subpixel_px=condition.depth_noise * DepthNoise().subpixel_px)
            depth = DepthSensor(noise, seed=seed).measure(depth)
        return self.perceiver.cloth_view(drawn.rgb, depth)


def axis_error_deg(vector: FloatArray, normal: float) -> float:
    """Signed angle in -90..90 degrees from the axis at ``normal`` rad to that of ``vector``."""
    return (math.degrees(math.atan2(vector[1], vector[0]) - normal) + 90) % 180 - 90


def measure(
    viewer: SyntheticCamera, condition: Condition, entrants: Mapping[str, Descriptor], phases: int
) -> pd.DataFrame:
    """One line per sheet and descriptor: true angle, signed error (NaN where no direction was given)."""
    lines = []
    for normal, sheet, seed in sheets(condition, phases):
        view = viewer.view(sheet, condition, seed)
        for name, descriptor in entrants.items():
            found = None if view is None else descriptor.direction(view)
            known = found is not None and bool(found.vector.any())
            error = axis_error_deg(found.vector, normal) if found is not None and known else math.nan
            lines.append({"group": condition.group, "condition": condition.name, "descriptor": name})
            lines[-1] |= {"normal_deg": math.degrees(normal), "error_deg": error}  # type: ignore[dict-item]
            if found is not None:
                lines[-1] |= {"coherence": found.coherence, "strength": found.strength}  # type: ignore[dict-item]
    return pd.DataFrame(lines)


def study(out: Path, *, phases: int = PHASES) -> pd.DataFrame:
    """Measure everything; ``out`` gets word.csv, word-tables.md, word-bias.png and word-light.png."""
    from layflat.app.benchmarks.word_figures import bias_figure, light_figure

    validators.writable_folder(out)
    cv2.setNumThreads(1)
    viewer, rows = SyntheticCamera(), list(conditions())
    made: dict[str, Descriptor] = {name: make() for name, make in DESCRIPTORS.items()}
    parts = []
    with Progress({"ladder": FRAME_S * ANGLES * phases, "conditions": FRAME_S * ANGLES * phases * len(rows)}) as bar:
        bar.phase("ladder", items=1)
        ladder = measure(viewer, rows[0], LADDER, 3 * phases)
        bar.advance()
        bar.phase("conditions", items=len(rows))
        for row in rows:
            parts.append(measure(viewer, row, made, phases))
            bar.advance(status=row.name)
    frame = pd.concat(parts, ignore_index=True)
    write_text(out / "word.csv", frame.to_csv(index=False, float_format="%.4f"))
    write_text(out / "word-tables.md", tables(ladder, frame))
    for name, figure in (("word-bias.png", bias_figure(ladder, list(LADDER))), ("word-light.png", light_figure(frame))):
        with atomic_write(out / name) as aside:
            aside.write_bytes(figure)
    return frame


def tables(ladder: pd.DataFrame, frame: pd.DataFrame) -> str:
    """Markdown: the ladder, then every condition."""
    lines = [
        "| what is computed | n | error, degrees: median | mean | largest | no direction |",
        "|---|---|---|---|---|---|",
    ]
    for name in LADDER:
        errors = ladder[ladder.descriptor == name].error_deg
        size = errors.abs()
        lines.append(
            f"| {name} | {len(errors)} | {size.median():.1f} | {size.mean():.1f} | {size.max():.1f} | {share(errors)} |"
        )
    names = list(dict.fromkeys(frame.descriptor))
    lines += ["", "| | " + " | ".join(f"`{name}`" for name in names) + " |", "|---|" + "---|" * len(names)]
    for (group, condition), part in frame.groupby(["group", "condition"], sort=False):
        cells = [cell(part[part.descriptor == name].error_deg) for name in names]
        lines.append(f"| {group}: {condition} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def cell(errors: pd.Series) -> str:
    """Median / largest error, and the share without a direction where there is any."""
    size = errors.abs().dropna()
    if size.empty:
        return "none"
    missing = f" ({share(errors)} none)" if errors.isna().any() else ""
    return f"{size.median():.1f} / {size.max():.0f}{missing}"


def share(errors: pd.Series) -> str:
    return f"{100 * errors.isna().mean():.0f} %"


def _main(
    out: Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Folder for tables and plots.")],
    phases: Annotated[int, typer.Option(help="Sheets for each direction.")] = PHASES,
) -> None:
    """Measure the descriptors over light and sensor, into DIR."""
    study(out, phases=validators.positive("--phases", phases))


def main(arguments: Sequence[str] | None = None) -> None:
    """``python -m layflat.app.benchmarks.word_study``."""
    from layflat.app.support.errors import run_command

    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(_main)
    raise SystemExit(run_command(lambda: app(arguments, standalone_mode=False)))


if __name__ == "__main__":
    main()
