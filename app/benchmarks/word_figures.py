"""Figures of docs/explanation/results/word.md as PNG bytes: errors over the wrinkles' direction and over the light."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from layflat.app.media.plot_style import DPI, INK, MUTED, STYLE

COLORS = {"word": "#c2571a", "word-axial": "#0f766e", "how": "#6d5bd0", "hog": "#b8336a"}
LIGHT = re.compile(r"from (\d+) degrees, (\d+) degrees high")


def bias_figure(ablation: pd.DataFrame, names: Sequence[str]) -> bytes:
    """Plot the signed error over the true direction, for some rows of the ablation."""
    shown = {names[2]: "#c2571a", names[3]: "#d9a441", names[4]: "#8aa4c8", names[-1]: "#0f766e"}
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(6.6, 3.6))
        for name, color in shown.items():
            part = ablation[ablation.descriptor == name].dropna()
            groups = part.groupby("normal_deg").error_deg
            centre = groups.median()
            axes.plot(part.normal_deg, part.error_deg, ".", color=color, markersize=3, alpha=0.35)
            axes.plot(centre.index, centre, color=color, linewidth=1.6, label=name.replace("`", ""))
        axes.axhline(0, color=MUTED, linewidth=0.8)
        axes.set(xlabel="direction across the wrinkles, degrees from +x", ylabel="error, degrees", ylim=(-90, 90))
        axes.set_xticks(range(-90, 91, 30))
        axes.set_yticks(range(-90, 91, 30))
        axes.grid(True)
        axes.legend(loc="upper right", fontsize=7.5)
        return _png(figure)


def light_figure(frame: pd.DataFrame) -> bytes:
    """Plot, polar and one per descriptor, the 90th percentile of the error over the light's azimuth, by its height."""
    light = frame[frame.group == "light"].copy()
    found = light.condition.str.extract(LIGHT).astype(float)
    light["azimuth"], light["elevation"] = found[0], found[1]
    light["size"] = light.error_deg.abs().fillna(90.0)
    names = list(dict.fromkeys(light.descriptor))
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(
            1, len(names), figsize=(3.0 * len(names), 3.3), subplot_kw={"projection": "polar"}, squeeze=False
        )
        figure.subplots_adjust(wspace=0.45)
        for axes, name in zip(panels[0], names, strict=True):
            part = light[light.descriptor == name].dropna(subset=["azimuth"])
            for shade, (elevation, ring) in zip(np.linspace(0.35, 1.0, 5), part.groupby("elevation"), strict=False):
                errors = ring.groupby("azimuth")["size"].quantile(0.9)
                turn = np.radians([*errors.index, errors.index[0] + 360])
                axes.plot(
                    turn, [*errors, errors.iloc[0]], color=COLORS.get(name, INK), alpha=shade, label=f"{elevation:g}"
                )
            axes.set_title(name, pad=14)
            axes.set_rlim(0, 90)
            axes.set_rticks([10, 30, 60, 90])
            axes.set_rlabel_position(112)
            axes.tick_params(labelsize=6.5)
        panels[0][-1].legend(title="light's height, deg", fontsize=6.5, title_fontsize=6.5, loc=(1.05, 0.0))
        title = "90th percentile of the error (degrees, no direction counts as 90) over the direction of the light"
        figure.suptitle(title, fontsize=9, x=0.12, ha="left")
        return _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, bbox_inches="tight")
    plt.close(figure)
    return buffer.getvalue()
