"""What a bench is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Literal

from layflat.data.environment_spec import ClothShape, EnvironmentSpec, StepLimits
from layflat.data.robot import RobotSpec
from layflat.data.types import STEP_S
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, DESCRIPTORS
from layflat.sim.cloth.cloth import HELD_STRETCH, ClothSpec, cloth_spec
from layflat.sim.cloth.starts import STARTS, Start
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import robot_spec

STEP_LIMITS: Mapping[str, StepLimits] = {"place": StepLimits(), "smooth": StepLimits(place=60)}
"""Step limits of each task."""


@dataclass(frozen=True, kw_only=True)
class SimConfig:
    """What a bench is made of; with a seed it determines a start."""

    robot: str
    task: str = "place"
    """Name of what is to be done: ``place``, or ``smooth``, which begins with a crumpled cloth."""
    physics: str = "bullet"
    """Name of the simulator."""
    start: Start = "hanging"
    """Hanging in the air after random moves; or crumpled on the table (pickers only), as chapter 3-2-2 begins; or laid
    flat with a far corner folded over (figure 5-2); or low over the table and swinging to the front (figure 5-1)."""
    descriptor: str = DEFAULT_DESCRIPTOR
    """Which direction an observation's ``word`` holds, by its name in layflat.perception.descriptors.registry."""
    cloth: str = "towel"
    table_friction: float = 1.0
    """Multiplied with the cloth's own 0.5; the product worked best at 0.5 of 0.3, 0.5 and 0.8."""
    control: Literal["impedance", "position"] = "impedance"
    camera: bool = True
    """False: observations have no image, and contact and WORD read 0 (for benchmarks of the physics)."""
    noise: bool = True
    """Depth noise of the camera."""
    step_s: float = STEP_S
    cloth_spec: ClothSpec = field(init=False)

    def __post_init__(self) -> None:
        robot = robot_spec(self.robot)
        if self.task not in STEP_LIMITS:
            raise SimError(f"unknown task {self.task!r}; the known ones are {', '.join(STEP_LIMITS)}")
        if self.task == "smooth" and self.start == "hanging":
            object.__setattr__(self, "start", "crumpled")
        if self.start not in STARTS:
            raise SimError(f"unknown start {self.start!r}; the known ones are {', '.join(STARTS)}")
        if self.start == "crumpled" and robot.n_points < 2:
            raise SimError(f"a crumpled start needs a robot that moves both corners, such as pickers, not {robot.name}")
        if self.descriptor not in DESCRIPTORS:
            raise SimError(f"unknown descriptor {self.descriptor!r}; the known ones are {', '.join(DESCRIPTORS)}")
        if not 0.01 <= self.step_s <= 1.0:
            raise SimError(f"step_s is {self.step_s}; it must be between 0.01 and 1")
        object.__setattr__(self, "cloth_spec", cloth_spec(self.cloth))

    def described(self) -> dict[str, str | float | bool]:
        """Return the settings, by name, that an `EnvironmentSpec` has no field for."""
        apart = ("robot", "task", "physics", "cloth", "descriptor", "step_s")
        return {item.name: getattr(self, item.name) for item in fields(self) if item.init and item.name not in apart}

    def environment_spec(self) -> EnvironmentSpec:
        """Return what policies and recorders need to know of this simulation."""
        cloth = self.cloth_spec
        shape = ClothShape(
            length_m=cloth.length_m,
            width_m=cloth.width_m,
            held_width_m=HELD_STRETCH * cloth.width_m,
            rows=cloth.rows,
            columns=cloth.columns,
        )
        return EnvironmentSpec(
            robot=self.robot_spec,
            cloth=self.cloth,
            task=self.task,
            physics=self.physics,
            limits=STEP_LIMITS[self.task],
            descriptor=self.descriptor,
            step_s=self.step_s,
            cloth_shape=shape,
            config=self.described(),
        )

    @property
    def robot_spec(self) -> RobotSpec:
        """Name and action axes of the robot."""
        return robot_spec(self.robot)

    @property
    def substeps(self) -> int:
        return max(1, round(self.step_s * self.cloth_spec.rate_hz))
