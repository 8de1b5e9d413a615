"""`layflat cloth`: cloths from files: what there is, whether one is good, and the mesh that fits a fabric."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from layflat.app.support.console import print_table
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.sim.cloth.cloth_file import ClothFile, read_cloth, write_mesh
from layflat.sim.cloth.registry import CLOTHS, is_cloth_file
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.fabric import quality
from layflat.sim.fabric.fit import fit_cloth
from layflat.sim.fabric.quality import ClothQuality

FIT_S = 60.0
"""Usual time of a fit."""
STRETCH_POINTS, BENDING_SHARE = 0.01, 0.20
"""Most that a cloth may differ from its file: hanging stretch, and bending length as a share."""


@dataclass(frozen=True, kw_only=True)
class ClothConfig:
    """A cloth file, or a preset's name to check."""

    file: str
    json: Path | None = None


def list_cloths() -> None:
    """Print the presets."""
    print_table(
        ["cloth", "length x width, m", "mass, g", "nodes", "rate, Hz"],
        [
            (
                spec.name,
                f"{spec.length_m:g} x {spec.width_m:g}",
                f"{1000 * spec.mass_kg:g}",
                f"{spec.rows} x {spec.columns}",
                f"{spec.rate_hz:g}",
            )
            for spec in CLOTHS.values()
        ],
        left=1,
    )


def check(config: ClothConfig) -> None:
    """Measure a cloth and print what fails; LayflatError where something does."""
    cloth = None if config.file in CLOTHS else _read(config.file)
    spec = CLOTHS[config.file] if cloth is None else _spec(cloth)
    measured = _measured(spec)
    problems = [*measured.problems, *([] if cloth is None else _differences(cloth, measured))]
    _report(spec, measured, problems, config.json)
    if problems:
        raise LayflatError(f"cloth {spec.name}: {'; '.join(problems)}")


def fit(config: ClothConfig, force: bool) -> None:
    """Find the mesh of a cloth file and write it there; UsageError where it has one already."""
    cloth, path = _read(config.file), Path(config.file)
    if cloth.mesh is not None and not force:
        raise UsageError(f"{path} has a [mesh] already; --force replaces it")
    started_s = time.monotonic()
    with Progress({"fit": FIT_S}) as progress:
        progress.phase("fit")
        try:
            spec, measured = fit_cloth(cloth, report=progress.note)
        except SimError as error:
            raise LayflatError(str(error)) from error
    fitted = cloth.with_mesh(spec)
    assert fitted.mesh is not None
    write_mesh(path, fitted.mesh)
    problems = [*measured.problems, *_differences(cloth, measured)]
    _report(spec, measured, problems, config.json)
    print(f"wrote [mesh] of {path} after {time.monotonic() - started_s:.0f} s")
    if problems:
        raise LayflatError(f"cloth {spec.name}: {'; '.join(problems)}")


def _read(text: str) -> ClothFile:
    if not is_cloth_file(text):
        raise UsageError(f"{text!r} is neither a cloth file (FILE.toml) nor one of {', '.join(CLOTHS)}")
    try:
        return read_cloth(Path(text))
    except SimError as error:
        raise UsageError(str(error)) from error


def _spec(cloth: ClothFile) -> ClothSpec:
    try:
        return cloth.spec()
    except SimError as error:
        raise UsageError(str(error)) from error


def _measured(spec: ClothSpec) -> ClothQuality:
    try:
        return quality.measure(spec)
    except SimError as error:
        raise LayflatError(str(error)) from error


def _differences(cloth: ClothFile, measured: ClothQuality) -> list[str]:
    """Return in what the simulated cloth is not the one that the file describes."""
    found = []
    wanted, got = cloth.hanging_stretch, measured.hanging_stretch
    if wanted is not None and abs(got - wanted) > STRETCH_POINTS:
        found.append(f"it stretches by {100 * got:.1f} % where it hangs, not {100 * wanted:.1f} %")
    wanted, got = cloth.bending_length_m, measured.bending_length_m
    if wanted is not None and abs(got / wanted - 1) > BENDING_SHARE:
        found.append(f"its bending length is {1000 * got:.1f} mm, not {1000 * wanted:.1f} mm")
    return found


def _report(spec: ClothSpec, measured: ClothQuality, problems: list[str], json: Path | None) -> None:
    rows = [
        ["hanging stretch", f"{100 * measured.hanging_stretch:.2f} %"],
        ["bending length", f"{1000 * measured.bending_length_m:.1f} mm"],
        ["sag of a held hem", f"{1000 * measured.hem_sag_m:.1f} mm"],
        ["sinks into the table", f"{1000 * measured.penetration_m:.1f} mm"],
        ["folds", measured.fold_diverges or "without diverging"],
        ["nodes, rate", f"{spec.rows} x {spec.columns}, {spec.rate_hz:g} Hz"],
    ]
    print_table(["cloth", spec.name], rows, left=2)
    if json is not None:
        write_json(json, {"cloth": spec.name, **vars(measured), "problems": problems})
