"""ClothSimulation: a robot, a cloth and a table as an environment (chapter 4-2-2)."""

from __future__ import annotations

from functools import partial

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import FLAT_AREA, DisturbanceRecord, DragTarget, GroundTruth, Observation
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.descriptors.registry import make_descriptor
from layflat.sim.camera.camera import D435_NOISE, Camera, default_pinhole
from layflat.sim.cloth import starts
from layflat.sim.cloth.cloth import Cloth
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.controller import DisturbanceController
from layflat.sim.disturbances.mouse_drag import MouseDrag, pick_node
from layflat.sim.disturbances.presets import DisturbanceSpec, DisturbanceTrajectory, disturbance_spec
from layflat.sim.errors import SimError
from layflat.sim.physics.bullet.air_drag import AirDrag
from layflat.sim.physics.bullet.world import GRAVITY_M_S2, World
from layflat.sim.robots.base import Robot
from layflat.sim.robots.registry import robot_type

DISTURBANCE_STREAM = 0xD157
"""Tells the chance of a disturbance from that of the start of the same seed."""


class ClothSimulation:
    """A simulated environment, which implements `layflat.policy.environment.Environment`.

    Each `reset` makes a new world. Use one simulation per process.
    """

    def __init__(self, config: SimConfig) -> None:
        self.config = config
        self.spec = config.environment_spec()
        self.world: World | None = None
        self.cloth_state: ClothState | None = None
        """Output of the perception for the last observation; None without a camera."""
        self._pinhole = default_pinhole()
        self._perception = PerceptionPipeline(
            self._pinhole, PerceptionConfig(descriptor=make_descriptor(config.descriptor))
        )

    def reset(self, seed: int) -> None:
        """Start an episode; the same seed in a fresh process gives the same bits."""
        self.close()
        config = self.config
        spec = config.cloth_spec
        self._seed = seed
        rng = np.random.default_rng([seed, 0x57A7])
        self.world = World(substep_s=1.0 / spec.rate_hz, table_friction=config.table_friction)
        first = starts.sample_initial_state(config.start, spec, rng)
        self.cloth = Cloth(self.world, spec, first.nodes)
        self.air = AirDrag(self.cloth)
        starts.attach(self.cloth, first.corners, self.air)
        self.robot: Robot = robot_type(config.robot)(self.cloth, first.corners, control=config.control)
        self.disturbance: DisturbanceController | None = None
        self._drag: MouseDrag | None = None
        self._drag_target_m: FloatArray | None = None
        self._force_n = np.zeros(3)
        self._nodes = self.cloth.nodes()
        if config.camera:
            self._start_camera(seed)
        self.robot.grip()
        drawn = starts.run_start_motion(
            config.start, self.cloth, self.robot, self.step, partial(self._start_disturbance_at_random, rng=rng), rng
        )
        self._halves_before = self.world.halves_done
        self.start = self._describe_start() | dict(first.about) | dict(drawn)

    def _start_camera(self, seed: int) -> None:
        """P_flat of Eq. 4-7 is measured through the same camera: the cloth as it would lie flat."""
        self.camera = Camera(
            self._running(),
            self.cloth,
            pinhole=self._pinhole,
            noise=D435_NOISE if self.config.noise else None,
            seed=seed,
        )
        flat = self._perception.perceive(*self.camera.capture(self.config.cloth_spec.flat_nodes()))
        self._calibrated = self._perception.with_flat_pixels(flat.cloth_pixels)

    def _describe_start(self) -> dict[str, float]:
        """What the random moves left behind, for the record: nothing of it is hidden from the reader of a file."""
        spec, nodes = (
            self.config.cloth_spec,
            self._nodes.reshape(self.config.cloth_spec.rows, self.config.cloth_spec.columns, 3),
        )
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
        """What the camera and the holder tell now."""
        rgb = depth = None
        word, strength, contact, lowest = np.zeros(2), 0.0, 0.0, None
        if self.config.camera:
            rgb, depth = self.camera.capture(self._nodes)
            state = self.cloth_state = self._calibrated.perceive(rgb, depth)
            word, strength = state.word, state.strength
            contact = min(1.0, state.contact_portion)
            lowest = state.free_edge_m
        return Observation(
            time_s=self.time_s,
            corner_positions=self.robot.corner_positions(),
            holder_position=self.robot.position(),
            word=word,
            word_strength=strength,
            contact_portion=contact,
            rgb=rgb if images else None,
            depth=depth if images else None,
            free_edge_m=lowest,
        )

    def ground_truth(self) -> GroundTruth:
        """The mesh, and what it says of contact and folds."""
        return GroundTruth(
            nodes=self._nodes,
            contact_portion_true=self.cloth.contact_portion_true(self._nodes),
            flat_area=self.cloth.flat_area(self._nodes),
        )

    def step(self, action: FloatArray) -> None:
        """One step: ``action`` (A,) m in the order of the robot's axes."""
        substeps = self._substeps()
        self.robot.start_step(np.asarray(action, dtype=float), substeps)
        self._advance(substeps)

    def guide(self, hand_m: FloatArray | None) -> FloatArray:
        """One step of kinesthetic teaching: the holder yields to a hand; what it did (A,) m is the action to record.

        ``hand_m``: where the hand is to be at the step's end, (3,) m for the hanger, which follows it along x
        and z on a spring of bounded force, (2, 3) m for the pickers, which follow it at a bounded speed. None: nobody
        holds on, and a hanger stays where it was left.
        """
        self._running()
        shape = self.robot.spec.hand_shape
        hand = None if hand_m is None else np.array(hand_m, dtype=float)
        if hand is not None and (hand.shape != shape or not np.isfinite(hand).all()):
            raise SimError(f"the hand's target is {hand.tolist()}; it must be finite numbers of shape {shape}, in m")
        before = self._held_at()
        spec = self.config.cloth_spec
        # A cloth that leaves the table along it is held up by its holder alone.
        load = spec.mass_kg * GRAVITY_M_S2 * (1.0 - self.cloth.contact_portion_true(self._nodes))
        substeps = self._substeps()
        self.robot.start_guided_step(hand, substeps, load)
        self._advance(substeps)
        return self._held_at() - before

    def _held_at(self) -> FloatArray:
        """(A,) m: what the actions displace."""
        robot = self.robot
        return robot.spec.pack(robot.position() if robot.spec.n_points == 1 else robot.corner_positions())

    def _substeps(self) -> int:
        """Of the step to come: twice as many where cloth lies on cloth; at the usual step it diverges when lifted."""
        return self.config.substeps * self._running().refine(self.cloth.layered(self._nodes))

    def _advance(self, substeps: int) -> None:
        """The substeps of one step."""
        world = self._running()
        if self._drag is not None and self._drag_target_m is not None:
            self._drag.start_step(self._drag_target_m, self.config.substeps * world.coarse_substep_s)
        impulse = self._impulse_n_s()
        for _ in range(substeps):
            # What sets gravity comes first: the arm carries its weight in the gravity of now.
            self.air.before_substep()
            if self.disturbance is not None:
                self.disturbance.before_substep()
            if self._drag is not None:
                self._drag.before_substep()
            self.robot.before_substep()
            world.step()
        self._nodes = self.cloth.nodes()
        self._force_n = (self._impulse_n_s() - impulse) / (substeps * world.substep_s)
        if self.disturbance is not None and self.disturbance.done:
            self.disturbance = None

    def _impulse_n_s(self) -> FloatArray:
        """(3,) N s that the disturbance and the pull of now have given so far."""
        acting = (self.disturbance, self._drag)
        return sum((given.impulse_n_s for given in acting if given is not None), np.zeros(3))

    def force_n(self) -> FloatArray:
        """(3,) N, world: mean total force of disturbances and pulls on the cloth in the last step."""
        return self._force_n.copy()

    def disturb(
        self, disturbance: str | DisturbanceSpec | DisturbanceRecord, repeat: int = 0
    ) -> DisturbanceRecord | None:
        """Start a disturbance, which acts in the following steps while `disturbed`; a previous one is cut off.

        Parameters
        ----------
        disturbance
            A name, a `DisturbanceSpec`, or a `DisturbanceRecord`, whose plan is repeated exactly. A record without a
            plan is drawn again by its name.
        repeat
            Number of disturbances of this episode before it, so that each is drawn independently.

        Returns
        -------
        DisturbanceRecord or None
            The name and the trajectory that was drawn, with ``first_step`` 0; None where it does nothing.
        """
        world, cloth = self._running(), self.config.cloth_spec
        if isinstance(disturbance, DisturbanceRecord) and disturbance.plan:
            plan = DisturbanceTrajectory.recorded(disturbance.plan, cloth)
        else:
            named = disturbance.name if isinstance(disturbance, DisturbanceRecord) else disturbance
            spec = disturbance_spec(named) if isinstance(named, str) else named
            plan = spec.sample(_disturbance_rng(self._seed, repeat), cloth)
        if self.disturbance is not None:
            self.disturbance.stop()
        self.disturbance = DisturbanceController(world, self.cloth, plan)
        if not plan.acts:
            return None
        name = disturbance if isinstance(disturbance, str) else disturbance.name
        return DisturbanceRecord(name=name, first_step=0, plan=plan.described())

    def _start_disturbance_at_random(self, spec: DisturbanceSpec, rng: np.random.Generator) -> DisturbanceTrajectory:
        plan = spec.sample(rng, self.config.cloth_spec)
        self.disturbance = DisturbanceController(self._running(), self.cloth, plan)
        return plan

    def drag(self, node: int, target_m: FloatArray) -> None:
        """Pull the cloth's ``node`` towards ``target_m``, (3,) m, world, with a bounded force, until `release`.

        Call it again, at most once a step, to move the target. A drag of another node releases the first one. It works
        at any time, also during a disturbance.
        """
        world, target = self._running(), np.array(target_m, dtype=float)
        if target.shape != (3,) or not np.isfinite(target).all():
            raise SimError(f"the drag's target is {target.tolist()}; it must be three finite numbers: x, y, z in m")
        if self._drag is not None and self._drag.node != node:
            self.release()
        if self._drag is None:
            self._drag = MouseDrag(world, self.cloth, node)
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
        return np.zeros((0, 3)) if self.disturbance is None else self.disturbance.hand_positions()

    def joint_angles(self) -> FloatArray:
        """Return the joint angles of the arm, (J,) rad; empty where there is no arm."""
        return self.robot.joint_angles()

    def pick_node(self, ray_origin: FloatArray, ray_direction: FloatArray) -> int | None:
        """Return the node at which a ray (3,) m, (3,) points, or None where it misses the cloth by more than 3 cm."""
        self._running()
        return pick_node(self._nodes, self.config.cloth_spec.triangles(), ray_origin, ray_direction)

    @property
    def disturbed(self) -> bool:
        return self.disturbance is not None

    def divergence_reason(self) -> str | None:
        """Return why the cloth has diverged, or None; call once a step."""
        return self.cloth.divergence_reason(self._nodes)

    @property
    def time_s(self) -> float:
        """Simulated time since the start's random moves ended."""
        world = self._running()
        return world.seconds(world.halves_done - self._halves_before)

    def success(self) -> bool:
        return self.cloth.flat_area(self._nodes) > FLAT_AREA

    def _running(self) -> World:
        if self.world is None:
            raise SimError("the bench has no world; call reset(seed) first")
        return self.world

    def close(self) -> None:
        if self.world is not None:
            self.world.close()
            self.world = None


def _disturbance_rng(seed: int, repeat: int) -> np.random.Generator:
    """Return the random numbers of the disturbance ``repeat`` of an episode."""
    return np.random.default_rng([seed, DISTURBANCE_STREAM, *([repeat] if repeat else [])])
