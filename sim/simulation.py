"""The robot: a cloth hangs in the air after 20 random moves, and is to lie flat on the table (chapter 4-2-2)."""

from __future__ import annotations

from functools import partial

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import FLAT_AREA, GroundTruth, Observation
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.descriptors.registry import descriptor
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
    """The bench: one world at a time, made anew by each ``reset``. One per process."""

    def __init__(self, settings: SimConfig) -> None:
        self.settings = settings
        self.world: World | None = None
        self.percept: ClothState | None = None
        """What perception made of the last observation; None without a camera."""
        self._pinhole = default_pinhole()
        self._perceiver = PerceptionPipeline(
            self._pinhole, PerceptionConfig(descriptor=descriptor(settings.descriptor))
        )

    def reset(self, seed: int) -> None:
        """Hang the cloth and make the start's random moves; the same seed in a fresh process gives the same bits."""
        self.close()
        settings = self.settings
        spec = settings.spec
        rng = np.random.default_rng([seed, 0x57A7])
        self.world = World(substep_s=1.0 / spec.rate_hz, table_friction=settings.table_friction)
        first = starts.sample_initial_state(settings.start, spec, rng)
        self.cloth = Cloth(self.world, spec, first.nodes)
        self.air = AirDrag(self.cloth)
        starts.attach(self.cloth, first.corners, self.air)
        self.robot: Robot = robot_type(settings.robot)(self.cloth, first.corners, control=settings.control)
        self.disturbance: DisturbanceController | None = None
        self._pull: MouseDrag | None = None
        self._pull_target: FloatArray | None = None
        self._force_n = np.zeros(3)
        self._nodes = self.cloth.nodes()
        if settings.camera:
            self._start_camera(seed)
        self.robot.grip()
        drawn = starts.run_start_motion(
            settings.start, self.cloth, self.robot, self.step, partial(self._befall, rng=rng), rng
        )
        self._halves_before = self.world.halves_done
        self.start = self._describe_start() | dict(first.about) | dict(drawn)

    def _start_camera(self, seed: int) -> None:
        """P_flat of Eq. 4-7 is measured through the same camera: the cloth as it would lie flat."""
        self.camera = Camera(
            self._running(),
            self.cloth,
            pinhole=self._pinhole,
            noise=D435_NOISE if self.settings.noise else None,
            seed=seed,
        )
        flat = self._perceiver.perceive(*self.camera.capture(self.settings.spec.flat_nodes()))
        self._calibrated = self._perceiver.with_flat_pixels(flat.cloth_pixels)

    def _describe_start(self) -> dict[str, float]:
        """What the random moves left behind, for the record: nothing of it is hidden from the reader of a file."""
        spec, nodes = self.settings.spec, self._nodes.reshape(self.settings.spec.rows, self.settings.spec.columns, 3)
        centre = self.robot.position()
        hem = nodes[-1]
        return {
            "holder_x_m": float(centre[0]),
            "holder_z_m": float(centre[2]),
            "swing_m": float(nodes[0, :, 0].mean() - centre[0]),
            "hem_side_m": float(hem[spec.columns // 2, 0] - centre[0]),
            "hem_sag_m": float(hem[[0, -1], 2].max() - hem[:, 2].min()),
            "table_friction": self.settings.table_friction,
        }

    def observe(self, *, images: bool = True) -> Observation:
        """What the camera and the holder tell now."""
        rgb = depth = None
        word, strength, contact, lowest = np.zeros(2), 0.0, 0.0, None
        if self.settings.camera:
            rgb, depth = self.camera.capture(self._nodes)
            percept = self.percept = self._calibrated.perceive(rgb, depth)
            word, strength = percept.word, percept.strength
            contact = min(1.0, percept.contact_portion)
            lowest = percept.lowest_m
        return Observation(
            time_s=self.time_s,
            corner_positions=self.robot.corner_positions(),
            holder_position=self.robot.position(),
            word=word,
            word_strength=strength,
            contact_portion=contact,
            rgb=rgb if images else None,
            depth=depth if images else None,
            lowest_m=lowest,
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

    def guide(self, hand_target_m: FloatArray | None) -> FloatArray:
        """One step of kinesthetic teaching: the holder yields to a hand; what it did (A,) m is the action to record.

        ``hand_target_m``: where the hand is to be at the step's end, (3,) m for the hanger, which follows it along x
        and z on a spring of bounded force, (2, 3) m for the pickers, which follow it at a bounded speed. None: nobody
        holds on, and a hanger stays where it was left.
        """
        self._running()
        shape = self.robot.spec.hand_shape
        hand = None if hand_target_m is None else np.array(hand_target_m, dtype=float)
        if hand is not None and (hand.shape != shape or not np.isfinite(hand).all()):
            raise SimError(f"the hand's target is {hand.tolist()}; it must be finite numbers of shape {shape}, in m")
        before = self._held_at()
        spec = self.settings.spec
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
        return self.settings.substeps * self._running().refine(self.cloth.layered(self._nodes))

    def _advance(self, substeps: int) -> None:
        """The substeps of one step."""
        world = self._running()
        self._follow_pull()
        impulse = self._impulse_n_s()
        for _ in range(substeps):
            # What sets gravity comes first: the arm carries its weight in the gravity of now.
            self.air.before_substep()
            if self.disturbance is not None:
                self.disturbance.before_substep()
            if self._pull is not None:
                self._pull.before_substep()
            self.robot.before_substep()
            world.step()
        self._nodes = self.cloth.nodes()
        self._force_n = (self._impulse_n_s() - impulse) / (substeps * world.substep_s)
        if self.disturbance is not None and self.disturbance.done:
            self.disturbance = None

    def _impulse_n_s(self) -> FloatArray:
        """(3,) N s that the disturbance and the pull of now have given so far."""
        acting = (self.disturbance, self._pull)
        return sum((given.impulse_n_s for given in acting if given is not None), np.zeros(3))

    def force_n(self) -> FloatArray:
        """(3,) N, world: mean total force of disturbances and pulls on the cloth in the last step."""
        return self._force_n.copy()

    def disturb(self, what: str | DisturbanceSpec, seed: int, repeat: int = 0) -> None:
        """Begin a disturbance, by name or as it is; it acts in the following steps until ``disturbed`` is false.

        ``repeat`` counts the disturbances of one episode, so that each has a chance of its own. One that still acts
        is cut off.
        """
        if self.disturbance is not None:
            self.disturbance.stop()
        self._befall(_spec(what), _chance(seed, repeat))

    def _befall(self, spec: DisturbanceSpec, rng: np.random.Generator) -> DisturbanceTrajectory:
        self.disturbance = DisturbanceController(self._running(), self.cloth, spec, rng)
        return self.disturbance.plan

    def disturbance_plan(self, what: str | DisturbanceSpec, seed: int, repeat: int = 0) -> DisturbanceTrajectory:
        """What ``disturb`` would do."""
        return _spec(what).schedule(_chance(seed, repeat), self.settings.spec)

    def pull(self, node: int, target_m: FloatArray) -> None:
        """From the next step on a hand of bounded force draws ``node`` to ``target_m`` (3,) m, world.

        Call it again, at most once a step, to lead the hand on; it stays at its target until ``let_go``. Another node
        is another hand: the first lets go. Works at any time, also beside a disturbance.
        """
        world, target = self._running(), np.array(target_m, dtype=float)
        if target.shape != (3,) or not np.isfinite(target).all():
            raise SimError(f"the pull's target is {target.tolist()}; it must be three finite numbers: x, y, z in m")
        if self._pull is not None and self._pull.node != node:
            self.let_go()
        if self._pull is None:
            self._pull = MouseDrag(world, self.cloth, node)
        self._pull_target = target

    def _follow_pull(self) -> None:
        if self._pull is not None and self._pull_target is not None:
            self._pull.start_step(self._pull_target, self.settings.substeps * self._running().coarse_substep_s)

    def let_go(self) -> None:
        """End the pull, if there is one."""
        if self._pull is not None:
            self._pull.let_go()
        self._pull = self._pull_target = None

    @property
    def pulled(self) -> int | None:
        """The node that is pulled at, or None."""
        return None if self._pull is None else self._pull.node

    @property
    def pulling(self) -> tuple[int, FloatArray] | None:
        """The node that is pulled at and its target (3,) m, or None."""
        if self._pull is None or self._pull_target is None:
            return None
        return self._pull.node, self._pull_target

    def pick(self, ray_origin: FloatArray, ray_direction: FloatArray) -> int | None:
        """The node that a ray (3,) m, (3,) points at, or None where it passes the cloth by more than 3 cm."""
        self._running()
        return pick_node(self._nodes, self.settings.spec.triangles(), ray_origin, ray_direction)

    @property
    def disturbed(self) -> bool:
        return self.disturbance is not None

    def instability(self) -> str | None:
        """Why the cloth has diverged, or None; call once a step."""
        return self.cloth.instability(self._nodes)

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


def _spec(what: str | DisturbanceSpec) -> DisturbanceSpec:
    return disturbance_spec(what) if isinstance(what, str) else what


def _chance(seed: int, repeat: int) -> np.random.Generator:
    """The first of an episode draws what it always drew."""
    return np.random.default_rng([seed, DISTURBANCE_STREAM, *([repeat] if repeat else [])])
