"""Accuracy of each descriptor by light and sensor: the tables and plots of the documentation's page on WORD.

``python -m layflat.app.benchmarks.word_study --out DIR`` renders sheets of known wrinkles from the simulation's camera,
adds a D435's depth noise, and compares every descriptor's direction with the wrinkles that were rendered.
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
from layflat.app.support.progress import Progress
from layflat.data.arrays import FloatArray
from layflat.data.atomic_files import atomic_path, write_text
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.descriptors.base import Descriptor
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.perception.descriptors.word import AXIAL_CONFIG, THESIS_CONFIG, WordDescriptor
from layflat.perception.synthetic_sheet import RenderConfig, SyntheticSheet, Wave, render_sheet
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor

ANGLES = 24
"""Number of wrinkle directions, over half a turn."""
PHASES = 2
"""Number of wrinkle positions on the sheet for each direction."""
RGB_NOISE = 3.0
SEED = 0
FRAME_S = 0.25
"""Expected wall time of one frame with all descriptors."""

PRINTED_MM = 17.0
"""8 pixels where a 0.35 m cloth is 165 pixels wide, as in a camera of 320x240 (figure 3-1 does not give its scale)."""
_PRINTED = replace(THESIS_CONFIG, wavelength_mm=PRINTED_MM, zero_mean=False)
_FILLED = replace(THESIS_CONFIG, fill=True, erosion_mm=14.0)
_UNCUT = replace(AXIAL_CONFIG, max_contrast=math.inf, rms=False)
ABLATION: Mapping[str, WordDescriptor] = {
    "Algorithm 1, kernel of Eq. 3-1 as it stands, lambda 17 mm (8 px)": WordDescriptor(config=_PRINTED),
    "the same, lambda 60 mm": WordDescriptor(config=replace(THESIS_CONFIG, zero_mean=False)),
    "`word`: the same, kernel of mean zero": WordDescriptor(),
    "outline filled, edge left out": WordDescriptor(config=_FILLED),
    "the same responses, mean axis": WordDescriptor(config=_FILLED, axial=True),
    "round even kernel": WordDescriptor(config=replace(_UNCUT, relief=False), axial=True),
    "relief beside brightness": WordDescriptor(config=_UNCUT, axial=True),
    "local contrast, cut": WordDescriptor(config=replace(AXIAL_CONFIG, rms=False), axial=True),
    "`word-axial`: root mean square instead of the sum": WordDescriptor(config=AXIAL_CONFIG, axial=True),
}
"""WORD step by step: each row has all that the rows above it have."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Sheets, light and sensor of one row of the tables."""

    group: str
    name: str
    wave: Wave = field(default_factory=lambda: Wave(wavelength_m=0.06))
    """Wrinkles; their normal and phase are varied."""
    cross_wave: float | None = None
    """Amplitude of a second wave at right angles, share of the first's."""
    render: RenderConfig = field(default_factory=lambda: RenderConfig(rgb_noise=RGB_NOISE))
    depth_noise: float = 1.0
    """Factor on a D435's disparity error."""

    def with_light(self, **changes: object) -> Condition:
        """Return the same under another light."""
        return replace(self, render=replace(self.render, light=replace(self.render.light, **changes)))  # type: ignore[arg-type]


def conditions() -> Iterator[Condition]:
    """Yield every row of the tables, in order."""
    usual = Condition(group="usual", name="60 mm, 2 mm, light from 45 degrees at 45 degrees")
    yield usual
    for wavelength in (45, 80, 100):
        yield replace(usual, group="wrinkles", name=f"{wavelength} mm long", wave=Wave(wavelength_m=wavelength / 1000))
    for amplitude in (1.0, 3.0):
        wave = Wave(wavelength_m=0.06, amplitude_m=amplitude / 1000)
        yield replace(usual, group="wrinkles", name=f"{amplitude:g} mm high", wave=wave)
    yield replace(usual, group="wrinkles", name="others across them, half as high", cross_wave=0.5)
    for elevation in (15, 30, 45, 60, 75):
        for azimuth in range(0, 360, 45):
            name = f"from {azimuth} degrees, {elevation} degrees high"
            yield replace(usual, group="light", name=name).with_light(azimuth_deg=azimuth, elevation_deg=elevation)
    yield replace(usual, group="light", name="straight above").with_light(elevation_deg=90)
    yield replace(usual, group="light", name="room light only").with_light(ambient=1.0)
    for exposure in (0.25, 0.5, 1.3, 1.8):
        yield replace(usual, group="exposure", name=f"{exposure:g} times").with_light(exposure=exposure)
    yield replace(usual, group="shadow", name="half of the cloth in shadow").with_light(shaded_from_m=0.0)
    yield replace(usual, group="shadow", name="low light, crests throw shadows").with_light(elevation_deg=8)
    for noise in (0.0, 0.5, 2.0, 3.0):
        yield replace(usual, group="depth noise", name=f"{noise:g} times a D435's", depth_noise=noise)
    yield replace(usual, group="depth noise", name="10 % missing", render=replace(usual.render, missing=0.10))
    for name, tint in (("red lamp", (1.3, 1.0, 0.8)), ("blue lamp", (0.8, 1.0, 1.2)), ("green cast", (0.9, 1.25, 0.9))):
        yield replace(usual, group="colour", name=name).with_light(tint=tint)


def sheets(condition: Condition, phases: int = PHASES) -> Iterator[tuple[float, SyntheticSheet, int]]:
    """Yield the angle of the wrinkles' perpendicular, rad, the sheet, and a seed."""
    for k in range(ANGLES * phases):
        normal = -math.pi / 2 + math.pi * (k // phases) / ANGLES
        rng = np.random.default_rng([SEED, k])
        wave = replace(condition.wave, normal=normal, phase=float(rng.uniform(0, 2 * math.pi)))
        waves = [wave]
        if condition.cross_wave is not None:
            smaller = condition.cross_wave * wave.amplitude_m
            phase = float(rng.uniform(0, 2 * math.pi))
            waves.append(replace(wave, normal=normal + math.pi / 2, amplitude_m=smaller, phase=phase))
        centre = (float(rng.uniform(0.2, 0.3)), float(rng.uniform(-0.03, 0.03)))
        yield normal, SyntheticSheet(waves=tuple(waves), centre=centre), k


class SyntheticCamera:
    """The simulation's camera over rendered sheets."""

    def __init__(self) -> None:
        self.camera = default_pinhole()
        self.pipeline = PerceptionPipeline(self.camera)

    def view(self, sheet: SyntheticSheet, condition: Condition, seed: int) -> ClothView | None:
        """Return the rectified view of a sheet; None if no cloth is seen."""
        frame = render_sheet(self.camera, sheet, replace(condition.render, seed=seed))
        depth = frame.depth
        if condition.depth_noise > 0:
            noise = replace(DepthNoise(), subpixel_px=condition.depth_noise * DepthNoise().subpixel_px)
            depth = DepthSensor(noise, seed=seed).measure(depth)
        return self.pipeline.cloth_view(frame.rgb, depth)


def axis_error_deg(vector: FloatArray, normal: float) -> float:
    """Return the signed angle in -90..90 degrees from the axis at ``normal`` rad to that of ``vector``."""
    return (math.degrees(math.atan2(vector[1], vector[0]) - normal) + 90) % 180 - 90


def measure(
    camera: SyntheticCamera, condition: Condition, descriptors: Mapping[str, Descriptor], phases: int
) -> pd.DataFrame:
    """Return one row per sheet and descriptor: true angle, signed error (NaN if no direction was given)."""
    rows = []
    for normal, sheet, seed in sheets(condition, phases):
        view = camera.view(sheet, condition, seed)
        for name, descriptor in descriptors.items():
            row: dict[str, object] = {"group": condition.group, "condition": condition.name, "descriptor": name}
            row |= {"normal_deg": math.degrees(normal), "error_deg": math.nan}
            if view is not None:
                found = descriptor.direction(view)
                if found.vector.any():
                    row["error_deg"] = axis_error_deg(found.vector, normal)
                row |= {"coherence": found.coherence, "strength": found.strength}
            rows.append(row)
    return pd.DataFrame(rows)


def study(out: Path, *, phases: int = PHASES) -> pd.DataFrame:
    """Measure everything and write word.csv, word-tables.md, word-bias.png and word-light.png to ``out``."""
    from layflat.app.benchmarks.word_figures import bias_figure, light_figure

    validators.writable_folder(out)
    cv2.setNumThreads(1)
    camera, rows = SyntheticCamera(), list(conditions())
    descriptors = {name: make() for name, make in DESCRIPTORS.items()}
    parts = []
    condition_s = FRAME_S * ANGLES * phases
    with Progress({"ablation": condition_s, "conditions": condition_s * len(rows)}) as bar:
        bar.phase("ablation", items=1)
        ablation = measure(camera, rows[0], ABLATION, 3 * phases)
        bar.advance()
        bar.phase("conditions", items=len(rows))
        for row in rows:
            parts.append(measure(camera, row, descriptors, phases))
            bar.advance(status=row.name)
    frame = pd.concat(parts, ignore_index=True)
    write_text(out / "word.csv", frame.to_csv(index=False, float_format="%.4f"))
    write_text(out / "word-tables.md", tables(ablation, frame))
    figures = {"word-bias.png": bias_figure(ablation, list(ABLATION)), "word-light.png": light_figure(frame)}
    for name, png in figures.items():
        with atomic_path(out / name) as temporary:
            temporary.write_bytes(png)
    return frame


def tables(ablation: pd.DataFrame, frame: pd.DataFrame) -> str:
    """Return Markdown tables: the ablation, then every condition."""
    lines = ["| what is computed | n | error, degrees: median | mean | largest | no direction |", "|---" * 6 + "|"]
    for name in ABLATION:
        errors = ablation[ablation.descriptor == name].error_deg
        size = errors.abs()
        numbers = " | ".join(f"{value:.1f}" for value in (size.median(), size.mean(), size.max()))
        lines.append(f"| {name} | {len(errors)} | {numbers} | {missing_share(errors)} |")
    names = list(dict.fromkeys(frame.descriptor))
    lines += ["", "| | " + " | ".join(f"`{name}`" for name in names) + " |", "|---|" + "---|" * len(names)]
    for (group, condition), part in frame.groupby(["group", "condition"], sort=False):
        cells = [error_cell(part[part.descriptor == name].error_deg) for name in names]
        lines.append(f"| {group}: {condition} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def error_cell(errors: pd.Series) -> str:
    """Return median / largest error, and the share without a direction if there is any."""
    size = errors.abs().dropna()
    if size.empty:
        return "none"
    missing = f" ({missing_share(errors)} none)" if errors.isna().any() else ""
    return f"{size.median():.1f} / {size.max():.0f}{missing}"


def missing_share(errors: pd.Series) -> str:
    """Return the percentage without a direction."""
    return f"{100 * errors.isna().mean():.0f} %"


def _main(
    out: Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Folder for tables and plots.")],
    phases: Annotated[int, typer.Option(help="Sheets for each direction.")] = PHASES,
) -> None:
    """Measure the descriptors over light and sensor, into DIR."""
    study(out, phases=validators.positive("--phases", phases))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``python -m layflat.app.benchmarks.word_study``."""
    from layflat.app.support.errors import run_command

    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(_main)
    raise SystemExit(run_command(lambda: app(arguments, standalone_mode=False)))


if __name__ == "__main__":
    main()
