"""ClothSimulation: a robot, a cloth and a table as an environment (chapter 4-2-2)."""

from __future__ import annotations

import copy
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.data.types import DisturbanceRecord, DragTarget, GroundTruth, Observation
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.descriptors.registry import make_descriptor
from layflat.sim.camera.camera import Camera, noise_of, pinhole_of
from layflat.sim.camera.renderer import light_of
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.controller import DisturbanceController
from layflat.sim.disturbances.draw import draw_disturbance
from layflat.sim.disturbances.mouse_drag import MouseDrag, pick_node
from layflat.sim.disturbances.presets import DisturbanceSpec, DisturbanceTrajectory
from layflat.sim.errors import SimError
from layflat.sim.latency import Latency
from layflat.sim.physics.base import GRAVITY_M_S2, Cloth, World
from layflat.sim.physics.registry import cloth_world
from layflat.sim.robots.base import Robot
from layflat.sim.robots.registry import robot_type
from layflat.sim.starts.base import StartScene, attach

START_STREAM = 0x57A7
"""Separates the random numbers of the start from others of the same seed."""
_STATE = ("robot", "_disturbance", "_drag", "_drag_target_m", "_force_n", "_nodes", "_latency", "cloth_state")
"""What a saved state holds besides the world and the camera's noise."""


class ClothSimulation:
    """A simulated environment, which implements `layflat.policy.environment.Environment`.

    Each `reset` makes a new world. Use one simulation per process.
    """

    def __init__(self, config: SimConfig) -> None:
        self.config = config
        self.world: World | None = None
        self.cloth_state: ClothState | None = None
        """Output of the perception for the last observation; None without a camera."""
        self.pinhole = pinhole_of(config, config.cloth_spec, behind=robot_type(config.robot).camera_behind)
        camera = CameraModel(**asdict(self.pinhole)) if config.camera else None
        self.spec = replace(config.environment_spec(), camera=camera)
        self._perception = PerceptionPipeline(
            self.pinhole, PerceptionConfig(descriptor=make_descriptor(config.descriptor))
        )

    def reset(self, seed: int) -> None:
        """Start an episode; the same seed in a fresh process gives the same bits."""
        self.close()
        config = self.config
        spec = config.cloth_spec
        self._seed = seed
        rng = np.random.default_rng([seed, START_STREAM])
        world = self.world = cloth_world(config.physics, spec, table_friction=config.table_friction)
        self._coarse_substeps = max(1, round(config.step_s / world.coarse_substep_s))
        initial = config.start_spec.initial_state(spec, robot_type(config.robot), rng)
        self.cloth: Cloth = world.add_cloth(spec, initial.nodes)
        world.add_air(self.cloth)
        attach(self.cloth, initial.corners)
        self.robot: Robot = robot_type(config.robot)(
            self.cloth, initial.corners, control=config.control, stiffness_n_m=config.arm_stiffness_n_m
        )
        self._disturbance: DisturbanceController | None = None
        self._drag: MouseDrag | None = None
        self._drag_target_m: FloatArray | None = None
        self._force_n = np.zeros(3)
        self._nodes = self.cloth.nodes()
        if config.camera:
            self._start_camera(seed)
        self.robot.grasp()

        def disturb(disturbance: DisturbanceSpec) -> DisturbanceTrajectory:
            plan = disturbance.sample(rng, spec)
            self._disturbance = DisturbanceController(self.cloth, plan)
            return plan

        scene = StartScene(cloth=self.cloth, robot=self.robot, step=self._step, disturb=disturb, rng=rng)
        drawn = config.start_spec.move(scene)
        self._ticks_before = world.ticks_done
        self.start = self._describe_start() | dict(drawn)
        self._latency = Latency(config, self.spec.robot.zeros())

    def _start_camera(self, seed: int) -> None:
        """Make the camera, and measure P_flat of Eq. 4-7 through it: the cloth as it would lie flat."""
        config, spec = self.config, self.config.cloth_spec
        noise = noise_of(config) if config.noise else None
        self.camera = Camera(self.cloth, pinhole=self.pinhole, noise=noise, light=light_of(config), seed=seed)
        flat = self._perception.perceive(*self.camera.capture(spec.flat_nodes(x_m=spec.home_x_m)))
        self._calibrated = self._perception.with_flat_pixels(flat.cloth_pixels)

    def _describe_start(self) -> dict[str, float]:
        """Return what the start's moves left behind."""
        spec = self.config.cloth_spec
        nodes = self._nodes.reshape(spec.rows, spec.columns, 3)
        centre = self.robot.position()
        hem = nodes[-1]
        return {
            "holder_x_m": float(centre[0]),
            "holder_z_m": float(centre[2]),
            "swing_m": float(nodes[0, :, 0].mean() - centre[0]),
            "hem_side_m": float(hem[spec.columns // 2, 0] - centre[0]),
            "hem_sag_m": float(hem[[0, -1], 2].max() - hem[:, 2].min()),
            "table_friction": self.config.table_friction,
        }

    def observe(self, *, images: bool = True) -> Observation:
        """Return what a policy may see now; without ``images``, with no camera frame in it.

        With a latency it is what there was some steps ago, at the time of now.
        """
        self._running()
        rgb = depth = state = None
        if self.config.camera:
            rgb, depth = self.camera.capture(self._nodes)
            state = self.cloth_state = self._calibrated.perceive(rgb, depth)
        seen = Observation(
            time_s=self.time_s,
            corner_positions=self.robot.corner_positions(),
            holder_position=self.robot.position(),
            word=np.zeros(2) if state is None else state.word,
            word_strength=0.0 if state is None else state.strength,
            contact_portion=0.0 if state is None else min(1.0, state.contact_portion),
            rgb=rgb if images else None,
            depth=depth if images else None,
            free_edge_m=None if state is None else state.free_edge_m,
        )
        return self._latency.observation(seen)

    def ground_truth(self) -> GroundTruth:
        """Return the mesh, its contact with the table and its flat area."""
        self._running()
        return GroundTruth(
            nodes=self._nodes,
            contact_portion_true=self.cloth.contact_portion_true(self._nodes),
            flat_area=self.cloth.flat_area(self._nodes),
        )

    def step(self, action: FloatArray) -> None:
        """Move the robot by ``action``, (A,) m in the order of its axes, in one control step.

        Like a border of the workspace, cloth that lies in a heap below the held edge stops a move down, and a jammed
        cloth every move but up. With a latency the action comes later.
        """
        self._running()
        self._step(self._latency.action(action))

    def _step(self, action: FloatArray) -> None:
        axes, move = self.robot.spec.axes, np.array(action, dtype=float)
        if move.shape == (len(axes),):
            lowest = self.cloth.drop_to_heap_m(self._nodes, self._held_points())
            move = np.maximum(move, [lowest[axis.point] if axis.axis == 2 else -np.inf for axis in axes])
            if self.cloth.is_jammed(self._nodes):
                move = np.where([axis.axis == 2 for axis in axes], np.maximum(move, 0.0), 0.0)
        substeps = self._substeps()
        self.robot.start_step(move, substeps)
        self._advance(substeps)

    def guide(self, hand_m: FloatArray | None) -> FloatArray:
        """Let a hand guide the robot for one step (kinesthetic teaching); return the resulting action, (A,) m.

        ``hand_m`` is where the hand is at the step's end, of the spec's ``hand_shape``, m, world; None: no hand.
        """
        self._running()
        hand = None if hand_m is None else _finite("hand", hand_m, self.robot.spec.hand_shape)
        spec, held = self.robot.spec, self._held_points()
        if hand is not None:
            lowest = self.cloth.drop_to_heap_m(self._nodes, held)
            hand[..., 2] = np.maximum(hand[..., 2], held[..., 2] + lowest.reshape(hand.shape[:-1]))
        before = spec.pack(self._held_points())
        # What does not lie on the table is held up by the robot alone.
        load = self.config.cloth_spec.mass_kg * GRAVITY_M_S2 * (1.0 - self.cloth.contact_portion_true(self._nodes))
        substeps = self._substeps()
        self.robot.start_guided_step(hand, substeps, load)
        self._advance(substeps)
        return spec.pack(self._held_points()) - before

    def _held_points(self) -> FloatArray:
        return self.robot.position() if self.robot.spec.n_points == 1 else self.robot.corner_positions()

    def _substeps(self) -> int:
        """Return the number for the next step, more where cloth lies on cloth."""
        parts = self.cloth.refinement(self._nodes)
        self._running().refine(parts)
        return self._coarse_substeps * parts

    def _advance(self, substeps: int) -> None:
        world = self._running()
        if self._drag is not None and self._drag_target_m is not None:
            self._drag.start_step(self._drag_target_m, self._coarse_substeps * world.coarse_substep_s)
        impulse = self._impulse_n_s()
        for _ in range(substeps):
            # The wind and the air come first: the arm carries its weight in the gravity of now.
            world.begin_substep()
            if self._disturbance is not None:
                self._disturbance.before_substep()
            if self._drag is not None:
                self._drag.before_substep()
            self.robot.before_substep()
            world.step()
        self._nodes = self.cloth.nodes()
        self._force_n = (self._impulse_n_s() - impulse) / (substeps * world.substep_s)
        if self._disturbance is not None and self._disturbance.done:
            self._disturbance = None

    def _impulse_n_s(self) -> FloatArray:
        acting = (self._disturbance, self._drag)
        return sum((given.impulse_n_s for given in acting if given is not None), np.zeros(3))

    def force_n(self) -> FloatArray:
        """Return the mean force of disturbances and drags on the cloth in the last step, (3,) N, world."""
        return self._force_n.copy()

    def disturb(
        self, disturbance: str | DisturbanceSpec | DisturbanceRecord, repeat: int = 0
    ) -> DisturbanceRecord | None:
        """Start a disturbance, which acts in the following steps while `disturbed`; a previous one is cut off.

        A record is repeated exactly, or by its name where it has no plan. ``repeat`` is the number of disturbances of
        this episode before it, so that each is drawn independently. Returns what was drawn; None where it does nothing.
        """
        self._running()
        plan, record = draw_disturbance(disturbance, seed=self._seed, repeat=repeat, cloth=self.config.cloth_spec)
        if self._disturbance is not None:
            self._disturbance.stop()
        self._disturbance = DisturbanceController(self.cloth, plan)
        return record

    def drag(self, node: int, target_m: FloatArray) -> None:
        """Pull the cloth's ``node`` towards ``target_m``, (3,) m, world, with a bounded force, until `release`.

        Call it again, at most once a step, to move the target. A drag of another node releases the first one.
        """
        self._running()
        target = _finite("drag", target_m, (3,))
        if self._drag is not None and self._drag.node != node:
            self.release()
        if self._drag is None:
            self._drag = MouseDrag(self.cloth, node)
        self._drag_target_m = target

    def release(self) -> None:
        """End the drag, if there is one."""
        if self._drag is not None:
            self._drag.release()
        self._drag = self._drag_target_m = None

    @property
    def drag_target(self) -> DragTarget | None:
        """The dragged node and its target, or None."""
        if self._drag is None or self._drag_target_m is None:
            return None
        return DragTarget(node=self._drag.node, target_m=self._drag_target_m)

    def hand_positions(self) -> FloatArray:
        """Return where a disturbance holds the cloth now, (K, 3) m, world."""
        return np.zeros((0, 3)) if self._disturbance is None else self._disturbance.hand_positions()

    def joint_angles(self) -> FloatArray:
        """Return the joint angles of the arm, (J,) rad; empty where there is no arm."""
        return self.robot.joint_angles()

    def pick_node(self, ray_origin: FloatArray, ray_direction: FloatArray) -> int | None:
        """Return the node at which a ray (3,) m, (3,) points, or None where it misses the cloth by more than 3 cm."""
        self._running()
        return pick_node(self._nodes, self.config.cloth_spec.triangles(), ray_origin, ray_direction)

    @property
    def disturbed(self) -> bool:
        """Whether a disturbance still acts, or the cloth has not come to rest after it."""
        return self._disturbance is not None

    def divergence_reason(self) -> str | None:
        """Return why the cloth has diverged, or None; call once a step."""
        return self.cloth.divergence_reason(self._nodes)

    @property
    def time_s(self) -> float:
        """Simulated time since the start's moves ended."""
        world = self._running()
        return world.seconds(world.ticks_done - self._ticks_before)

    def success(self) -> bool:
        """Whether the cloth is now as the task wants it."""
        return self.config.task_spec.is_success(self.ground_truth())

    def save(self) -> Any:
        """Return the whole state, for `restore`; SimError where the physics cannot (see `World.saves_state`)."""
        state = self._running().save()
        camera = self.camera.save() if self.config.camera else None
        return state, camera, copy.deepcopy({name: getattr(self, name) for name in _STATE})

    def restore(self, state: Any) -> None:
        """Go on from a state that `save` gave in this episode: the same actions give the same bits again."""
        world, camera, own = state
        self._running().restore(world)
        if self.config.camera:
            self.camera.restore(camera)
        vars(self).update(copy.deepcopy(own))

    def _running(self) -> World:
        if self.world is None:
            raise SimError("the simulation has not started; call reset(seed) first")
        return self.world

    def close(self) -> None:
        """Free the world; `reset` makes a new one. May be called twice."""
        if self.world is not None:
            self.world.close()
            self.world = None


def _finite(what: str, target: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    values = np.array(target, dtype=float)
    if values.shape != shape or not np.isfinite(values).all():
        raise SimError(f"the {what}'s target is {values.tolist()}; it must be finite numbers of shape {shape}, in m")
    return values
