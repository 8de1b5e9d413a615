"""SafetyLimits: what the station's arm may be asked for. Checked before a command is sent."""

from __future__ import annotations

import numpy as np

from layflat.app.hardware.station_config import RobotConfig, StationError
from layflat.data.arrays import FloatArray

TOUCH_M = 0.020
"""A policy may ask for this much beyond the workspace, as it does on the simulated bench: it ends at the border."""


class RefusedCommandError(StationError):
    """A command was not sent; the arm holds its position."""


class SafetyLimits:
    """Workspace box, speed and force of a station."""

    def __init__(self, config: RobotConfig) -> None:
        self._low, self._high = np.array(config.workspace_low_m), np.array(config.workspace_high_m)
        self._speed_m_s = config.speed_m_s
        self._lead_m = config.force_n / config.stiffness_n_m

    def allowed(self, current: FloatArray, wanted: FloatArray, measured: FloatArray, duration_s: float) -> FloatArray:
        """Return where the set point may go from ``current``, (3,) m world; RefusedCommandError for what is unsafe.

        A little beyond the workspace ends at its border. Far beyond it, or faster than the station's speed, is
        refused. The set point stays near the ``measured`` hanger: a blocked arm is pulled by a bounded force only.
        """
        if not np.isfinite(wanted).all():
            raise RefusedCommandError(f"the command is {np.asarray(wanted).tolist()}; it must be finite: the arm holds")
        inside = np.clip(wanted, self._low, self._high)
        beyond = float(np.abs(wanted - inside).max())
        if beyond > TOUCH_M:
            raise RefusedCommandError(
                f"the command goes to {np.round(wanted, 3).tolist()} m, {100 * beyond:.0f} cm outside the workspace "
                f"{self._low.tolist()} to {self._high.tolist()}: the arm holds"
            )
        speed = float(np.linalg.norm(wanted - current)) / duration_s
        if speed > self._speed_m_s * 1.001:
            raise RefusedCommandError(
                f"the command jumps: {speed:.2f} m/s, where the station allows {self._speed_m_s:g}: the arm holds"
            )
        return np.clip(inside, measured - self._lead_m, measured + self._lead_m).clip(self._low, self._high)
