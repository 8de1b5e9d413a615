"""make_twin: a whole station without hardware, over the real protocols."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from layflat.app.hardware.franka_arm import FrankaArm
from layflat.app.hardware.realsense_camera import RealSenseCamera
from layflat.app.hardware.station_config import CameraConfig, RobotConfig, StationConfig
from layflat.app.hardware.station_environment import StationEnvironment
from layflat.app.hardware.twin.arm_process import ArmProcess
from layflat.app.hardware.twin.cloth_twin import ClothTwin
from layflat.data.camera import CameraModel
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.robots.panda import BASE_POSITION_M, inverse_kinematics
from layflat.sim.starts.base import home_corners


class Twin:
    """A station whose arm, cloth and camera are simulated; `env` is made of the same classes as the real one."""

    def __init__(
        self, config: StationConfig | None = None, *, descriptor: str = DEFAULT_DESCRIPTOR, slow: float = 1.0
    ) -> None:
        """Start all of it; ``config`` gives cloth, stiffness, limits; its host and camera are not used."""
        config = config or StationConfig(robot=RobotConfig(host="twin"))
        cloth = config.cloth_spec()
        pinhole = default_pinhole(cloth)
        home = home_corners(cloth).mean(axis=0) - np.array(config.robot.base_m)
        self.arm_process = ArmProcess(inverse_kinematics(home + np.array(BASE_POSITION_M)).tolist())
        model = CameraModel(**asdict(pinhole))
        self.cloth = ClothTwin(cloth, pinhole, model)
        self.config = replace(
            config,
            robot=replace(config.robot, host=self.arm_process.host),
            camera=_camera_config(config.camera, model),
        )
        try:
            self.arm = FrankaArm(self.config.robot)
            self.arm.start_control()
            # P_flat of Eq. 4-7 through the same camera, before the first episode.
            self.cloth.begin(home_corners(cloth), 0)
            flat = PerceptionPipeline(pinhole).perceive(*self.cloth.flat_frame())
            self.camera = RealSenseCamera(*self.cloth.camera.opener(), self.config.camera)
            self.env = StationEnvironment(
                self.config,
                self.arm,
                self.camera,
                scene=self.cloth,
                descriptor=descriptor,
                flat_pixels=flat.cloth_pixels,
                slow=slow,
            )
        except BaseException:
            self.arm_process.close()
            raise

    def close(self) -> None:
        """End all processes and threads; may be called twice."""
        self.env.close()
        self.arm_process.close()

    def __enter__(self) -> Twin:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _camera_config(config: CameraConfig, model: CameraModel) -> CameraConfig:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(model.cam_to_world[:3, :3]).as_quat()
    x, y, z = model.cam_to_world[:3, 3].tolist()
    return replace(
        config,
        width=model.width,
        height=model.height,
        position_m=(x, y, z),
        rotation_xyzw=tuple(turn.tolist()),
        stale_s=2.0,
    )
