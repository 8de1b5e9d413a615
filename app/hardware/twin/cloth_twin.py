"""ClothTwin: the bench's cloth and camera, carried along by the pose that the arm reports."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from layflat.app.hardware.station_environment import corners_at
from layflat.app.hardware.twin.software_camera import FPS, SoftwareCamera
from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.data.types import STEP_S, DisturbanceRecord, GroundTruth
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.sim.camera.camera import D435_NOISE, Camera
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.disturbances.controller import DisturbanceController
from layflat.sim.disturbances.draw import draw_disturbance
from layflat.sim.physics.base import Cloth, World
from layflat.sim.physics.registry import make_world
from layflat.sim.starts.base import attach, narrowed

FIRST_FRAMES = 2
"""The syncer of librealsense pairs colour and depth from the second frame on."""


class ClothTwin:
    """A simulated cloth under a real arm, or one that speaks its protocol; the camera sees the cloth alone."""

    physics = "twin"

    def __init__(self, cloth: ClothSpec, pinhole: PinholeCamera, model: CameraModel) -> None:
        self.camera = SoftwareCamera(model)
        self._spec, self._pinhole = cloth, pinhole
        self._world: World | None = None
        self._disturbance: DisturbanceController | None = None

    def begin(self, corners: FloatArray, seed: int) -> None:
        """Hang the cloth at ``corners``, (2, 3) m world."""
        self.free()
        spec, self._seed = self._spec, seed
        self._world = world = make_world(substep_s=1.0 / spec.rate_hz)
        level = narrowed(corners - [0.0, corners[:, 1].mean(), 0.0], spec)
        level[:, 2] = corners[:, 2].mean()
        self.cloth: Cloth = world.add_cloth(spec, spec.hanging_nodes(level))
        world.add_air(self.cloth)
        attach(self.cloth, corners)
        self._corners = corners
        self._holders = world.add_holders(corners)
        self._holders.grasp(self.cloth, spec.corners)
        self._nodes = self.cloth.nodes()
        self._view = Camera(self.cloth, pinhole=self._pinhole, noise=D435_NOISE, seed=seed)
        for _ in range(FIRST_FRAMES):
            self._send()

    def flat_frame(self) -> tuple[Any, Any]:
        """Return the camera's picture of the cloth laid flat, for calibration."""
        return self._view.capture(self._spec.flat_nodes(x_m=self._spec.home_x_m))

    def follow(self, path: list[FloatArray], axes: FloatArray) -> None:
        """Simulate one control step in which the held corners go along the arm's measured path; send its frame."""
        world = self._world
        assert world is not None
        parts = self.cloth.refinement(self._nodes)
        world.refine(parts)
        substeps = max(1, round(STEP_S * self._spec.rate_hz)) * parts
        ends = np.stack([corners_at(place, axes, self._spec.held_width_m) for place in path])
        points = np.concatenate([self._corners[None], ends]).reshape(-1, 6)
        at = np.linspace(0.0, len(points) - 1, substeps + 1)[1:]
        wanted = np.column_stack([np.interp(at, np.arange(len(points)), column) for column in points.T])
        last = self._corners.reshape(6)
        for row in wanted:
            world.begin_substep()
            if self._disturbance is not None:
                self._disturbance.before_substep()
            velocity = ((row - last) / world.substep_s).reshape(2, 3)
            self._holders.move(row.reshape(2, 3).tolist(), velocity.tolist())
            world.step()
            last = row
        self._corners = last.reshape(2, 3)
        self._nodes = self.cloth.nodes()
        if self._disturbance is not None and self._disturbance.done:
            self._disturbance = None
        self._send()

    @contextmanager
    def streaming(self) -> Iterator[None]:
        """Send pictures of the resting cloth at the camera's rate from a thread, while no step passes."""
        over = threading.Event()

        def send() -> None:
            due = time.monotonic()
            while not over.wait(max(0.0, due - time.monotonic())):
                self._send()
                due += 1.0 / FPS

        thread = threading.Thread(target=send, name="twin-camera", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def _send(self) -> None:
        self.camera.feed(*self._view.capture(self._nodes))

    def ground_truth(self) -> GroundTruth:
        """Return the mesh, its contact with the table and its flat area."""
        return GroundTruth(
            nodes=self._nodes,
            contact_portion_true=self.cloth.contact_portion_true(self._nodes),
            flat_area=self.cloth.flat_area(self._nodes),
        )

    def disturb(self, disturbance: Any, repeat: int) -> DisturbanceRecord | None:
        """Start the disturbance that the bench draws for this seed."""
        plan, record = draw_disturbance(disturbance, seed=self._seed, repeat=repeat, cloth=self._spec)
        if self._disturbance is not None:
            self._disturbance.stop()
        self._disturbance = DisturbanceController(self.cloth, plan)
        return record

    @property
    def disturbed(self) -> bool:
        """Whether a disturbance still acts, or the cloth has not come to rest after it."""
        return self._disturbance is not None

    def free(self) -> None:
        """Free the world."""
        if self._world is not None:
            self._world.close()
        self._world = self._disturbance = None

    def close(self) -> None:
        """Free the world and the camera; may be called twice."""
        self.free()
        self.camera.close()
