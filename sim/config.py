"""SimConfig: the settings of a simulation."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from layflat.data.environment_spec import ClothShape, EnvironmentSpec
from layflat.data.robot import RobotSpec
from layflat.data.types import STEP_S
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, DESCRIPTORS
from layflat.sim.cloth.registry import PREFIX, cloth_settings, cloth_spec, remember
from layflat.sim.cloth.spec import DEFAULT_CLOTH, ClothSpec
from layflat.sim.errors import SimError, look_up
from layflat.sim.physics.registry import DEFAULT_PHYSICS, PHYSICS
from layflat.sim.robots.base import Control
from layflat.sim.robots.registry import robot_spec
from layflat.sim.starts.base import Start
from layflat.sim.starts.registry import STARTS
from layflat.sim.tasks import DEFAULT_TASK, TASKS, Task


@dataclass(frozen=True, kw_only=True)
class SimConfig:
    """Settings of a simulation; with a seed they determine an episode's start."""

    robot: str
    task: str = DEFAULT_TASK
    cloth: str = DEFAULT_CLOTH
    """A preset or a cloth file; afterwards its name."""
    physics: str = DEFAULT_PHYSICS
    start: str | None = None
    """How an episode begins, by name; None: as usual for the task.

    ``hanging`` in the air after random moves; ``folded-corner``, laid flat with a far corner folded over (figure 5-2);
    ``swinging`` to the front low over the table (figure 5-1); ``crumpled`` on the table (chapter 3-2-2)."""
    descriptor: str = DEFAULT_DESCRIPTOR
    """Name of the descriptor whose direction is an observation's ``word``."""
    table_friction: float = 1.0
    """Factor on the cloth's own friction of 0.5; the product worked best at 0.5 of 0.3, 0.5 and 0.8."""
    control: Control = "impedance"
    camera: bool = True
    """False: observations have no image, and contact and WORD read 0 (for benchmarks of the physics)."""
    noise: bool = True
    """Depth noise of the camera."""
    step_s: float = STEP_S
    own_cloth: ClothSpec | None = None
    """A cloth that is no preset, which ``cloth`` then names."""
    cloth_spec: ClothSpec = field(init=False)
    task_spec: Task = field(init=False)
    start_spec: Start = field(init=False)

    def __post_init__(self) -> None:
        robot, task = self.robot_spec, look_up("task", self.task, TASKS)
        look_up("physics", self.physics, PHYSICS)
        look_up("descriptor", self.descriptor, DESCRIPTORS)
        start = look_up("start", task.starts[0] if self.start is None else self.start, STARTS)
        if start.name not in task.starts:
            raise SimError(f"start is {start.name!r}; task {task.name} begins with {' or '.join(task.starts)}")
        if start.two_points and robot.n_points < 2:
            raise SimError(
                f"a {start.name} start needs a robot that moves both corners, such as pickers, not {robot.name}"
            )
        if not 0.01 <= self.step_s <= 1.0:
            raise SimError(f"step_s is {self.step_s}; it must be between 0.01 and 1")
        cloth = cloth_spec(self.cloth) if self.own_cloth is None else remember(self.own_cloth)
        own = cloth if cloth_settings(cloth) else None
        derived = {"start": start.name, "task_spec": task, "start_spec": start}
        for name, value in (derived | {"cloth": cloth.name, "cloth_spec": cloth, "own_cloth": own}).items():
            object.__setattr__(self, name, value)

    def environment_spec(self) -> EnvironmentSpec:
        """Return the part of the settings that policies and recorders need."""
        own = {item.name for item in fields(EnvironmentSpec)}
        names = [item.name for item in fields(self) if item.init and item.name not in (*own, "own_cloth")]
        sizes = {f"{PREFIX}{name}": getattr(self.cloth_spec, name) for name in ("length_m", "width_m")}
        shape = {item.name: getattr(self.cloth_spec, item.name) for item in fields(ClothShape)}
        return EnvironmentSpec(
            robot=self.robot_spec,
            cloth=self.cloth,
            task=self.task,
            demonstrator=self.task_spec.demonstrator,
            physics=self.physics,
            limits=self.task_spec.limits,
            descriptor=self.descriptor,
            step_s=self.step_s,
            cloth_shape=ClothShape(**shape),
            config={name: getattr(self, name) for name in names} | cloth_settings(self.cloth_spec) | sizes,
        )

    @property
    def robot_spec(self) -> RobotSpec:
        """Name and action axes of the robot."""
        return robot_spec(self.robot)

    @property
    def substeps(self) -> int:
        """Physics steps of a control step, as long as they are not refined."""
        return max(1, round(self.step_s * self.cloth_spec.rate_hz))
