"""The seam between the simulation and a physics engine: a world with a table, and the bodies in it.

An engine subclasses `World` and `Cloth`, satisfies the protocols, and is added to `layflat.sim.physics.registry`.
Methods that are called in every substep take and return what costs an engine least.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.geometry import ClothGeometry
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError

GRAVITY_M_S2 = 9.81
TABLE_SIZE_M = (1.6, 1.4, 0.1)
TABLE_CENTRE_M = (0.3, 0.0)
TABLE_RGBA = (0.86, 0.86, 0.84, 1.0)
NEAR_M, FAR_M = 0.05, 4.0
"""Depths between which a body is drawn."""
TICKS = 8
"""Parts of a coarse step in which time is counted: the finest substep."""
Vector = tuple[float, float, float]


class Cloth(ClothGeometry, ABC):
    """A cloth in a world."""

    world: World

    def __deepcopy__(self, memo: object) -> Cloth:
        """Return the cloth itself: copies of what holds it, made to save a simulation, hold the same one."""
        return self

    @abstractmethod
    def nodes(self) -> FloatArray:
        """Return the nodes, (N, 3) m, world, in grid order; read-only, and cheap to ask again within a substep."""

    def velocities(self) -> FloatArray | None:
        """Return the nodes' velocities, (N, 3) m/s, world; None where the engine does not show them."""
        return None

    def divergence_reason(self, nodes: FloatArray) -> str | None:
        """Return why the cloth has diverged, or None; call once a step."""
        return self.divergence_at(nodes, self.world.time_s)


class Holders(Protocol):
    """Kinematic points that carry nodes of a cloth: pickers, fingers."""

    def grasp(self, cloth: Cloth, nodes: Sequence[int]) -> None:
        """Attach the nodes; each must be where its point is."""

    def move(self, positions_m: Sequence[list[float]], velocities_m_s: Sequence[list[float]]) -> None:
        """Put the points there for the next substep."""

    def stop(self) -> None:
        """Stay in place while the world is only stepped."""

    def release(self) -> None:
        """Let go and vanish."""


class ForceAnchors(Protocol):
    """Hands of bounded force on some nodes of a cloth."""

    start: FloatArray
    """Where the hands took hold, (K, 3) m, world."""

    def positions(self) -> FloatArray:
        """Return where the hands are, (K, 3) m, world."""

    def impulse_n_s(self) -> FloatArray:
        """Return the momentum that the cloth has been given so far, (3,) N s, world."""

    def pull(self, targets_m: FloatArray, velocity_m_s: FloatArray) -> None:
        """Pull each hand towards its target (K, 3), which moves at ``velocity_m_s`` (3,), for one substep."""

    def release(self) -> None:
        """Take the hands away; use them no more."""


class Arm(Protocol):
    """A robot arm of J revolute joints with a tool, whose base is fixed."""

    def reset_joints(self, angles: FloatArray) -> None:
        """Put the joints there, at rest."""

    def joint_states(self) -> tuple[list[float], list[float]]:
        """Return angles, rad, and speeds, rad/s."""

    def set_torques(self, torques_n_m: FloatArray) -> None:
        """Drive the joints (J,) with torques for one substep."""

    def drive_joints(self, angles: FloatArray, speeds: FloatArray, torque_limits_n_m: FloatArray) -> None:
        """Drive the joints with stiff motors until further notice; limits of 0 switch them off."""

    def tool_pose(self) -> tuple[FloatArray, FloatArray]:
        """Return the tool's position (3,) m and its axes (3, 3) as columns, world."""

    def push_tool(self, force_n: FloatArray, position_m: FloatArray) -> None:
        """Apply a force (3,), world, to the tool for one substep."""

    def dynamics(
        self, angles: list[float], speeds: list[float]
    ) -> tuple[Sequence[Sequence[float]], Sequence[Sequence[float]], FloatArray, Sequence[float]]:
        """Return the tool's Jacobians, linear and angular (3, J), inertia (J, J), and gravity and Coriolis torques."""

    def grasp(self, cloth: Cloth, nodes: Sequence[int]) -> None:
        """Attach nodes of a cloth to the tool, each where it is now."""


class Solid(Protocol):
    """A closed body that the camera sees, such as an arm."""

    def mesh(self) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
        """Return its vertices (V, 3) m, world, triangles (T, 3), counter-clockwise from outside, and colours (T, 3)."""


class Air(Protocol):
    """Surroundings of a cloth that slow it down."""

    def update(self) -> None:
        """Act on the coming substep."""


class World(ABC):
    """A table whose top is z = 0, gravity and air, and the clock of the substeps; one per process.

    Bodies come and go at any time between two substeps. An engine whose model is compiled gathers them, and compiles
    at the next `step`.
    """

    gravity_m_s2: Vector
    """Acceleration of the cloth and of all bodies now, wind included, world axes."""
    saves_state: ClassVar[bool] = False
    """Whether `save` and `restore` work; a process that forks branches any world."""

    def __init__(self, *, substep_s: float, table_friction: float) -> None:
        """Make an empty world; ``table_friction`` is a Coulomb factor, multiplied with the cloth's own."""
        if not 0.0 < substep_s <= 1 / 100:
            raise SimError(f"the physics step is {substep_s} s; it must be above 0 and at most 0.01 s")
        if not 0.0 <= table_friction <= 5.0:
            raise SimError(f"the table's friction is {table_friction}; it must be between 0 and 5")
        self.coarse_substep_s = self.substep_s = substep_s
        self.substeps_done = 0
        self._ticks = TICKS
        """Ticks of a substep."""
        self.ticks_done = 0
        """Time in parts of a coarse step: a whole number, so that an unrefined world keeps its times to the bit."""
        self.solids: list[Solid] = []
        """Visible bodies besides the table and the cloth, which the camera draws itself."""
        self._still_gravity: Vector = (0.0, 0.0, -GRAVITY_M_S2)
        self._wind: Vector | None = None
        self._air: Air | None = None

    def __deepcopy__(self, memo: object) -> World:
        return self

    @classmethod
    def rate_hz(cls, spec: ClothSpec) -> float:
        """Return the substeps per second that this engine makes for a cloth."""
        return spec.rate_hz

    @abstractmethod
    def add_cloth(self, spec: ClothSpec, nodes: FloatArray | None = None) -> Cloth:
        """Make a cloth at ``nodes`` (N, 3) m, its shape at rest, so without a fold; None: flat, high in the air."""

    @abstractmethod
    def add_air(self, cloth: Cloth) -> None:
        """Surround the cloth with still air, which stops its swing."""

    @abstractmethod
    def add_holders(self, positions_m: FloatArray) -> Holders:
        """Make kinematic points at (K, 3) m."""

    @abstractmethod
    def add_force_anchors(self, cloth: Cloth, nodes: Sequence[int], force_limit_n: float) -> ForceAnchors:
        """Take hold of nodes where they are now; ``force_limit_n`` is that of all hands together."""

    @abstractmethod
    def add_arm(self, urdf: bytes, base_position_m: Vector, *, joints: int, tool_m: float) -> Arm:
        """Make an arm without collisions, motors and damping; its tool lies ``tool_m`` along the last link's z."""

    def set_gravity(self, gravity_m_s2: Vector) -> None:
        """Set the uniform acceleration of all that moves, wind apart, m/s^2, world axes."""
        if not all(math.isfinite(g) for g in gravity_m_s2):
            raise SimError(f"gravity is {gravity_m_s2}; it must be finite")
        self._still_gravity = gravity_m_s2
        self._add_up_gravity()

    def set_wind(self, acceleration_m_s2: Vector | None) -> None:
        """Blow at the cloth with a uniform acceleration, world axes, until further notice."""
        self._wind = acceleration_m_s2
        self._add_up_gravity()

    def _add_up_gravity(self) -> None:
        x, y, z = self._still_gravity
        if self._wind is not None:
            x, y, z = x + self._wind[0], y + self._wind[1], z + self._wind[2]
        self.gravity_m_s2 = (x, y, z)
        self._apply_gravity()

    def begin_substep(self) -> None:
        """Call before forces are applied in a substep: updates the air."""
        if self._air is not None:
            self._air.update()

    @abstractmethod
    def step(self) -> None:
        """Simulate one substep."""

    @abstractmethod
    def close(self) -> None:
        """Free the engine; the world is unusable afterwards. May be called twice."""

    @abstractmethod
    def _apply_substep(self) -> None:
        """Make `substep_s` the engine's step."""

    @abstractmethod
    def _apply_gravity(self) -> None:
        """Make `gravity_m_s2` the engine's gravity."""

    def save(self) -> Any:
        """Return the whole state, for `restore`; SimError where the engine cannot."""
        raise SimError("this physics cannot save its state; fork the process instead, or use physics mujoco")

    def restore(self, state: Any) -> None:
        """Go on from a state that `save` gave, to the bit, as often as wanted; what was made since is gone."""
        raise SimError("this physics cannot restore a state; fork the process instead, or use physics mujoco")

    def refine(self, parts: int) -> None:
        """Divide a coarse step into 1, 2, 4 or 8 substeps from now on."""
        if TICKS % parts:
            raise SimError(f"a step cannot be divided into {parts} parts; it must be 1, 2, 4 or 8")
        if self.substep_s != self.coarse_substep_s / parts:
            self.substep_s = self.coarse_substep_s / parts
            self._ticks = TICKS // parts
            self._apply_substep()

    def ticks(self, duration_s: float) -> int:
        """Return a duration in whole coarse steps, at least one, counted as `ticks_done` is."""
        return TICKS * max(1, round(duration_s / self.coarse_substep_s))

    def seconds(self, ticks: int) -> float:
        """Return the duration of so many ticks."""
        return ticks * (self.coarse_substep_s / TICKS)

    @property
    def time_s(self) -> float:
        """Simulated time since the world was made."""
        return self.seconds(self.ticks_done)
