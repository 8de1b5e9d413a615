"""SimConfig: the settings of a simulation."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from layflat.data.environment_spec import ClothShape, EnvironmentSpec
from layflat.data.robot import RobotSpec
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, DESCRIPTORS
from layflat.sim.cloth.registry import CLOTHS, cloth_settings, cloth_spec, recorded_cloth, remember
from layflat.sim.cloth.spec import DEFAULT_CLOTH, HELD_STRETCH, ClothSpec
from layflat.sim.conditions.keys import Conditions, Setting, keys
from layflat.sim.errors import SimError, look_up
from layflat.sim.physics.registry import DEFAULT_PHYSICS, check_physics
from layflat.sim.robots.registry import robot_spec
from layflat.sim.starts.base import Start
from layflat.sim.starts.registry import STARTS
from layflat.sim.tasks import DEFAULT_TASK, TASKS, Task


@dataclass(frozen=True, kw_only=True)
class SimConfig(Conditions):
    """Settings of a simulation, its conditions among them; with a seed they determine an episode's start."""

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
    camera: bool = True
    """False: observations have no image, and contact and WORD read 0 (for benchmarks of the physics)."""
    noise: bool = True
    """Depth noise of the camera."""
    own_cloth: ClothSpec | None = None
    """A cloth that is no preset, which ``cloth`` then names."""
    cloth_spec: ClothSpec = field(init=False)
    """The cloth under these conditions."""
    task_spec: Task = field(init=False)
    start_spec: Start = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        robot, task = self.robot_spec, look_up("task", self.task, TASKS)
        check_physics(self.physics)
        look_up("descriptor", self.descriptor, DESCRIPTORS)
        start = look_up("start", task.starts[0] if self.start is None else self.start, STARTS)
        if start.name not in task.starts:
            raise SimError(f"start is {start.name!r}; task {task.name} begins with {' or '.join(task.starts)}")
        if start.two_points and robot.n_points < 2:
            raise SimError(
                f"a {start.name} start needs a robot that moves both corners, such as pickers, not {robot.name}"
            )
        cloth = cloth_spec(self.cloth) if self.own_cloth is None else self.own_cloth
        cloth = remember(replace(cloth, held_stretch=HELD_STRETCH))
        own = cloth if cloth_settings(cloth) else None
        derived = {"start": start.name, "task_spec": task, "start_spec": start}
        cloths = {"cloth": cloth.name, "cloth_spec": self.changed_cloth(cloth), "own_cloth": own}
        for name, value in (derived | cloths).items():
            object.__setattr__(self, name, value)

    def environment_spec(self) -> EnvironmentSpec:
        """Return the part of the settings that policies and recorders need."""
        own = {item.name for item in fields(EnvironmentSpec)}
        names = [item.name for item in fields(self) if item.init and item.name not in (*own, "own_cloth")]
        usual = CLOTHS[self.cloth] if self.own_cloth is None else self.own_cloth
        own_cloth = cloth_settings(usual)
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
            config={name: getattr(self, name) for name in names} | own_cloth,
        )

    @classmethod
    def of(cls, **settings: Any) -> SimConfig:
        """Return the simulation of settings by name; SimError for an unknown one names the nearest."""
        known = [item.name for item in fields(cls) if item.init]
        for name in settings:
            if name not in known:
                near = difflib.get_close_matches(name, known, 1)
                hint = f"; did you mean {near[0]}?" if near else f"; known are {', '.join(known)}"
                raise SimError(f"unknown setting {name!r}{hint}")
        return cls(**settings)

    def under(self, settings: Mapping[str, Setting]) -> SimConfig:
        """Return the same simulation under other conditions."""
        return replace(self, **settings)  # type: ignore[arg-type]

    @property
    def robot_spec(self) -> RobotSpec:
        """Name and action axes of the robot."""
        return robot_spec(self.robot)


def recorded_spec(name: str, settings: Mapping[str, Any]) -> ClothSpec:
    """Return the cloth of an episode as it was simulated; SimError where it is unknown."""
    conditions = Conditions(**{key: settings[key] for key in keys() if key in settings})
    return conditions.changed_cloth(recorded_cloth(name, settings))
