"""fit_cloth: nodes, springs, damping and rate with which a fabric is simulated, at the least cost that passes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from layflat.sim.cloth.cloth_file import ClothFile
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.fabric import quality
from layflat.sim.fabric.quality import ClothDivergedError, ClothQuality
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.physics.registry import DEFAULT_PHYSICS

CELLS = 12
"""Cells along the longer side, as far as CELL_M allows."""
CELL_M = (0.017, 0.032)
MAX_NODES = 400
STIFFNESS = 4.6
"""Largest elastic stiffness over mass of a node and square of the rate: explicit springs oscillate apart above it."""
DAMPING = 1.1
"""Damping over the least that is stable, elastic stiffness / rate / 2."""
RATE_STEP_HZ = 20.0
LEAST_RATE_HZ, MOST_RATE_HZ = 200.0, 600.0
STRETCH_TOLERANCE, BENDING_TOLERANCE = 0.0015, 0.06
"""Error of the stretch, and relative error of the bending length, with which the search ends."""
BENDING_N_M = (0.005, 60.0)
"""Range in which the stiffness of bending springs is sought."""
ELASTIC_SHARE = 2.0
TRIES = 5

Report = Callable[[str], None]
T = TypeVar("T")


def fit_cloth(
    cloth: ClothFile, physics: str = DEFAULT_PHYSICS, *, report: Report = lambda line: None
) -> tuple[ClothSpec, ClothQuality]:
    """Find the mesh of a fabric.

    Parameters
    ----------
    cloth
        With ``hanging_stretch`` and ``bending_length_m``; an older mesh does not matter.
    report
        Called with a line about each stage.

    Returns
    -------
    tuple of ClothSpec and ClothQuality
        The cloth, and what it measures in the tests.

    Raises
    ------
    SimError
        Where the fabric cannot be simulated stably, with the limit that it exceeds.
    """
    if cloth.hanging_stretch is None or cloth.bending_length_m is None:
        raise SimError(f"cloth {cloth.name} needs hanging_stretch and bending_length_m to be fitted")
    rows, columns = grid(cloth.length_m, cloth.width_m)
    least_hz = LEAST_RATE_HZ
    for _ in range(TRIES):
        spec = _with_springs(cloth, rows, columns, _first_elastic(cloth, rows, columns), BENDING_N_M[0], least_hz)
        spec = _fit_stretch(cloth, spec, physics, report, least_hz)
        spec = _fit_bending(cloth, spec, physics, report, least_hz)
        # Bending springs carry a part of the weight.
        spec = _fit_stretch(cloth, spec, physics, report, least_hz)
        spec, measured = _stable(quality.measure, spec, physics, report)
        if measured.fold_diverges is None and measured.penetration_m <= quality.PENETRATION_M:
            return spec, measured
        report(f"at {spec.rate_hz:g} Hz: {'; '.join(measured.problems)}")
        least_hz = min(1.25 * spec.rate_hz, MOST_RATE_HZ)
    raise SimError(f"cloth {cloth.name} cannot be simulated stably: {'; '.join(measured.problems)}")


def grid(length_m: float, width_m: float) -> tuple[int, int]:
    """Return rows and columns of nodes."""
    cell = float(np.clip(max(length_m, width_m) / CELLS, *CELL_M))
    cell = max(cell, 1.02 * float(np.sqrt(length_m * width_m / (np.sqrt(MAX_NODES) - 1) ** 2)))
    return round(length_m / cell) + 1, round(width_m / cell) + 1


def _first_elastic(cloth: ClothFile, rows: int, columns: int) -> float:
    """Return the stiffness of columns of springs that stretch as asked, each by the weight below it."""
    weight = cloth.mass_kg / (rows * columns) * GRAVITY_M_S2
    return weight * rows * (rows - 1) / 2 / (float(cloth.hanging_stretch or 0) * cloth.length_m)


def _with_springs(
    cloth: ClothFile, rows: int, columns: int, elastic_n_m: float, bending_n_m: float, least_hz: float
) -> ClothSpec:
    """Return the cloth with these springs at the lowest rate that is stable; SimError where there is none.

    Springs along the threads are at least ELASTIC_SHARE times as stiff as those of bending, which would else carry the
    cloth: then it stretches less than asked.
    """
    elastic_n_m = max(elastic_n_m, ELASTIC_SHARE * bending_n_m)
    node_kg = cloth.mass_kg / (rows * columns)
    needed = max(least_hz, float(np.sqrt((elastic_n_m + bending_n_m) / node_kg / STIFFNESS)))
    rate = RATE_STEP_HZ * float(np.ceil(needed / RATE_STEP_HZ - 1e-9))
    if rate > MOST_RATE_HZ:
        raise SimError(
            f"cloth {cloth.name} would need {rate:.0f} physics steps a second, at most {MOST_RATE_HZ:.0f} are"
            f" made; allow it more than {cloth.hanging_stretch} of hanging_stretch, or check mass and size"
        )
    values: dict[str, Any] = {name: getattr(cloth, name) for name in ("name", "length_m", "width_m", "mass_kg")}
    return ClothSpec(
        **values,
        friction=cloth.friction,
        rows=rows,
        columns=columns,
        elastic_n_m=float(f"{elastic_n_m:.4g}"),
        damping_n_s_m=_damping(elastic_n_m, rate),
        bending_n_m=float(f"{bending_n_m:.4g}"),
        rate_hz=rate,
    )


def _damping(elastic_n_m: float, rate_hz: float) -> float:
    return float(f"{DAMPING * elastic_n_m / rate_hz / 2:.4g}")


def _at_rate(spec: ClothSpec, rate_hz: float) -> ClothSpec:
    rate = RATE_STEP_HZ * float(np.ceil(rate_hz / RATE_STEP_HZ))
    return replace(spec, rate_hz=rate, damping_n_s_m=_damping(spec.elastic_n_m, rate))


def _stable(
    measure: Callable[[ClothSpec, str], T], spec: ClothSpec, physics: str, report: Report
) -> tuple[ClothSpec, T]:
    """Return a measure of the cloth, and the cloth at the first rate at which it does not diverge."""
    while True:
        try:
            return spec, measure(spec, physics)
        except ClothDivergedError:
            report(f"at {spec.rate_hz:g} Hz it diverges")
            if spec.rate_hz >= MOST_RATE_HZ:
                raise
            spec = _at_rate(spec, min(1.25 * spec.rate_hz, MOST_RATE_HZ))


def _fit_stretch(cloth: ClothFile, spec: ClothSpec, physics: str, report: Report, least_hz: float) -> ClothSpec:
    """Scale the springs until the cloth stretches as asked: the stretch is nearly their compliance."""
    wanted = float(cloth.hanging_stretch or 0)
    for _ in range(TRIES):
        spec, got = _stable(quality.hanging_stretch, spec, physics, report)
        report(f"{spec.elastic_n_m:g} N/m at {spec.rate_hz:g} Hz: hanging stretch {100 * got:.2f} %")
        if abs(got - wanted) < STRETCH_TOLERANCE:
            break
        elastic = spec.elastic_n_m * float(np.clip(got / wanted, 0.3, 3.0))
        found = _with_springs(cloth, spec.rows, spec.columns, elastic, spec.bending_n_m, least_hz)
        if found.elastic_n_m == spec.elastic_n_m:
            break
        spec = found
    return spec


def _fit_bending(cloth: ClothFile, spec: ClothSpec, physics: str, report: Report, least_hz: float) -> ClothSpec:
    """Halve the range of the bending springs' stiffness until the bending length is as asked."""
    wanted = float(cloth.bending_length_m or 0)
    low, high, elastic = np.log(BENDING_N_M[0]), np.log(BENDING_N_M[1]), spec.elastic_n_m
    for _ in range(8):
        bending = float(f"{np.exp((low + high) / 2):.3g}")
        found = _with_springs(cloth, spec.rows, spec.columns, elastic, bending, least_hz)
        spec, got = _stable(quality.bending_length_m, found, physics, report)
        report(f"bending springs of {bending:g} N/m: bending length {1000 * got:.1f} mm")
        if abs(got / wanted - 1) < BENDING_TOLERANCE:
            break
        low, high = (low, np.log(bending)) if got > wanted else (np.log(bending), high)
    return spec
