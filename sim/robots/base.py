"""Robot: the base class of what holds the cloth's two corners and carries them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.cloth_frame import NOMINAL_M
from layflat.data.robot import RobotSpec
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import Arm, Cloth, World
from layflat.sim.robots.arm_shape import ArmShape

Control: TypeAlias = Literal["impedance", "position"]
"""How an arm is driven: it yields to a push, or its joints are stiff."""
STIFFNESS_N_M = 400.0
"""Usual stiffness of an arm's springs along all axes (chapter 3-3-1)."""


class Robot(ABC):
    """Holds the cloth's two corners and moves them by displacements, one per control step.

    A new robot is a subclass in a file of its own and a line in `layflat.sim.robots.registry`. It is made at its home
    pose with its clips or pickers at the corners' positions, where the cloth's corner nodes are already; then `grasp`
    is called.
    """

    spec: ClassVar[RobotSpec]
    """Name and action axes."""
    start_step_m: ClassVar[float]
    """Largest random displacement along each axis in one of the start's steps."""
    camera_behind: ClassVar[bool] = False
    """Whether the camera stands behind the robot's start: arms on both sides would hide the cloth from the side."""
    workspace_low_m: ClassVar[tuple[float, float, float]]
    """Lowest coordinates of a held point, world, with a cloth that is no longer than the towel."""
    workspace_high_m: ClassVar[tuple[float, float, float]]
    """Highest coordinates of a held point, likewise."""

    @abstractmethod
    def __init__(
        self,
        cloth: Cloth,
        corner_positions: FloatArray,
        *,
        control: Control = "impedance",
        stiffness_n_m: float = STIFFNESS_N_M,
    ) -> None:
        """Make the robot for ``cloth`` in its world; ``corner_positions`` (2, 3) m, row 0 at +y.

        An arm is driven by ``control``, with springs of ``stiffness_n_m``.
        """

    @abstractmethod
    def corner_positions(self) -> FloatArray:
        """Return where the held corners really are, (2, 3) m, world; row 0 at +y."""

    @abstractmethod
    def position(self) -> FloatArray:
        """Return the midpoint of the held corners, (3,) m, world."""

    @abstractmethod
    def grasp(self) -> None:
        """Attach the cloth's corners, which are at `corner_positions` already."""

    @abstractmethod
    def start_step(self, action: FloatArray, substeps: int) -> None:
        """Begin one control step: ``action`` (A,) m in the order of the axes, spread evenly over ``substeps``."""

    @abstractmethod
    def start_guided_step(self, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Begin one control step in which a hand guides the robot.

        ``hand_m``: position of the hand at the end, of the spec's ``hand_shape``; None: there is no hand. ``load_n``:
        weight of the cloth that hangs from the robot.
        """

    @abstractmethod
    def before_substep(self) -> None:
        """Move the kinematic points or apply the torques of the next substep."""

    @abstractmethod
    def hold(self) -> None:
        """Stay in place while the world is only stepped, as benchmarks do, until the next control step."""

    @classmethod
    def within_reach(cls, corners: FloatArray, cloth: ClothSpec) -> FloatArray:
        """Return the corners (2, 3) m that are nearest to the wanted ones within workspace and cloth."""
        centre = corners.mean(axis=0)
        return corners - centre + np.clip(centre, *cls.workspace(cloth))

    @classmethod
    def workspace(cls, cloth: ClothSpec) -> tuple[FloatArray, FloatArray]:
        """Return lowest and highest coordinates of a held point, (3,) m, world: further out for a longer cloth."""
        longer, home = max(0.0, cloth.length_m - NOMINAL_M), np.array([cloth.home_x_m, 0.0, 0.0])
        low, high = np.array(cls.workspace_low_m), np.array(cls.workspace_high_m)
        return home + low - [0.1 * longer, 0.0, 0.0], home + high + [longer, 0.0, 0.85 * longer]

    def joint_angles(self) -> FloatArray:
        """Return the joint angles of the arm, (J,) rad; empty without an arm."""
        return np.zeros(0)

    @classmethod
    def joint_angles_at(cls, position: FloatArray, cloth: ClothSpec) -> FloatArray:
        """Return the joint angles (J,) rad at which `position` is (3,) m with ``cloth``; empty without an arm."""
        return np.zeros(0)

    @classmethod
    def arm_shape(cls, cloth: ClothSpec) -> ArmShape | None:
        """Return the arm's shape, to draw it without an engine; None without an arm."""
        return None

    @classmethod
    def add_arm(cls, world: World, cloth: ClothSpec) -> Arm | None:
        """Add the arm to a world, to simulate or to draw it; None without an arm."""
        return None
