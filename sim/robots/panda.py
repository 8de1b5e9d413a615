"""The Panda arm with a hanger in its hand: dimensions, limits, and inverse kinematics with the hand straight down.

The arm stands beside the cloth, not behind it: with the hand straight down a Panda covers radii of 0.30 to 0.80 m near
the table, which is less than the 0.7 m that the hanger travels along x. From the side that travel is an arc of radii
0.40 to 0.53 m, and a camera on the other side of the table looks under the forearm.
"""

from __future__ import annotations

import math

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Vector

JOINTS = 7
TORQUE_LIMIT_N_M = np.array([87.0] * 4 + [12.0] * 3)

BASE_POSITION_M = (0.25, 0.40, 0.0)
"""Beside the table's middle, facing +x; the hanger works to its right."""

# Distances between joint axes, m.
SHOULDER_HEIGHT_M = 0.333
UPPER_ARM_M = 0.316
ELBOW_OFFSET_M = 0.0825
FOREARM_M = 0.384
WRIST_OFFSET_M = 0.088
FLANGE_M = 0.107
HAND_YAW_RAD = -math.pi / 4
"""Turn of the hand on the last link, about its axis."""

GRIP_DEPTH_M = 0.105
"""Distance from the flange to where the closed fingers hold the hanger's bar."""
CLIP_DROP_M = 0.070
"""Distance from the bar down to the corners in the clips: fingers and bar stay above the table when the corners lie on
it."""
TOOL_M = FLANGE_M + GRIP_DEPTH_M + CLIP_DROP_M
"""Distance from the last link's frame to the corners' midpoint, along its z."""


def inverse_kinematics(centre: FloatArray, base_m: Vector = BASE_POSITION_M, *, yaw_rad: float = 0.0) -> FloatArray:
    """Return the joint angles (7,) rad: hand straight down, bar along y, corners' midpoint at ``centre`` (3,) m world.

    ``yaw_rad`` turns the hand about z from there.

    Exact, elbow up. Joints 3 and 5 stay at zero, so that shoulder, elbow and wrist lie in one vertical plane and the
    law of cosines gives the elbow. The arm stands at ``base_m``. Limits are not checked, reach is: SimError.
    """
    x, y = centre[0] - base_m[0], centre[1] - base_m[1]
    out = math.hypot(x, y) - WRIST_OFFSET_M
    up = centre[2] + TOOL_M - base_m[2] - SHOULDER_HEIGHT_M
    upper, fore = math.hypot(UPPER_ARM_M, ELBOW_OFFSET_M), math.hypot(FOREARM_M, ELBOW_OFFSET_M)
    reach = math.hypot(out, up)
    if not abs(upper - fore) < reach < upper + fore:
        raise SimError(f"the arm cannot reach {np.round(centre, 3).tolist()} m with its hand straight down")
    # Tilts from the vertical, in the arm's plane.
    lead = math.acos((upper**2 + reach**2 - fore**2) / (2 * upper * reach))
    upper_tilt = math.atan2(out, up) - lead
    elbow_out, elbow_up = upper * math.sin(upper_tilt), upper * math.cos(upper_tilt)
    fore_tilt = math.atan2(out - elbow_out, up - elbow_up) + math.atan2(ELBOW_OFFSET_M, FOREARM_M)
    joint1 = math.atan2(y, x)
    joint2 = upper_tilt - math.atan2(ELBOW_OFFSET_M, UPPER_ARM_M)
    return np.array([joint1, joint2, 0.0, joint2 - fore_tilt, 0.0, fore_tilt, joint1 - HAND_YAW_RAD - yaw_rad])
