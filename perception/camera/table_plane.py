"""The table's plane from a depth image, and the camera's pose that follows from it: nobody has to measure the stand.

A plane m . P = 1 in camera axes is, since P = z (u, v, 1), the linear function 1/z = m . (u, v, 1) of the ray's slopes
u and v at every tilt. A stereo camera's error is constant in disparity, and so in 1/z: near and far pixels count alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import FloatArray, PinholeCamera
from layflat.perception.camera.rectified_view import BoolArray
from layflat.perception.errors import PerceptionError

RESIDUAL_PER_M = 0.008
"""A pixel whose 1/z is farther than this from the plane is no table: 8 mm at 1 m, three times a D435's noise."""
RESIDUAL_M = 0.005
"""From nearby, where noise is small, a table may still be bent by this much: by its make or by the sensor's errors."""
WIDEST = 3.0
"""The final fit takes pixels from as far as this times the above, if they scatter so."""
MIN_POINTS = 400
"""Depth pixels that a plane must at least be fitted to."""
MIN_SHARE = 0.2
"""Share of them that must lie on it; a table without other objects in the picture has more than 0.9."""
MAX_TILT_DEG = 80.0
"""Between the optical axis and the table's perpendicular; beyond, the table is seen edge on."""
RIM_SHARE = 0.01
"""Of the image's width: a depth pixel is matched over a window, so that the cloth's rim draws its neighbours up."""
RING_SHARE = 0.3
"""Width of the ring around the cloth, as a share of its side."""
RANSAC_POINTS, FIT_POINTS = 4000, 80_000
"""Pixels, drawn by chance, that trials and the final fit are made with."""
MAX_TRIALS = 1500
"""Three points drawn by chance lie on a plane with MIN_SHARE of the pixels in 1 of 125 trials."""
STEP_PER_M = 0.0005
"""Half the step of a depth in whole millimetres at 1 m, in 1/z: residuals below this say nothing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TablePlane:
    """The table, in camera axes (x right, y down, z forward)."""

    normal: NDArray[np.float64]
    """(3,) unit vector from the table to the camera's side."""
    distance_m: float
    """From the camera to the plane, along the normal."""
    rms_m: float
    """Scatter of the depth pixels about the plane, along the normal, without outliers."""
    share: float
    """0..1: how many of the depth pixels beside the cloth lie on it."""
    pixels: int
    """Depth pixels that the fit was made with."""

    @property
    def tilt_deg(self) -> float:
        """Between the optical axis and the table's perpendicular; 0 looks straight down."""
        return math.degrees(math.acos(min(1.0, -float(self.normal[2]))))

    def camera(self, lens: Intrinsics) -> PinholeCamera:
        """The camera over this table.

        Its world has z = 0 on the table and the origin below the camera; x is the image's right, laid on the table
        along the perpendicular; y, at a right angle to x, runs to the side of the image's top. Directions in table
        coordinates are then the image's, x right and y up, freed from the foreshortening of a tilted view.
        """
        right = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(self.normal, right), self.normal])
        pose[2, 3] = self.distance_m
        return lens.at(pose)


def fit_table_plane(
    depth: FloatArray, lens: Intrinsics, *, rng: np.random.Generator, cloth: BoolArray | None = None
) -> TablePlane:
    """The table in ``depth`` (H, W) m, 0 or not finite where missing.

    Cloth (H, W) takes no part. What lies in a ring around it does, so that a larger floor is not taken for the table
    and a sensor's bent field of depth matters less; without ``cloth`` the whole image does.
    RANSAC (scikit-learn's) finds the plane, least squares on its inliers refines it. ``rng`` draws pixels and trials.
    """
    if depth.shape != (lens.height, lens.width):
        raise PerceptionError(f"depth has shape {depth.shape}; this camera's images are {(lens.height, lens.width)}")
    for wanted in _places(depth, cloth):
        rays, inverse = _points(depth, lens, wanted, rng)
        reach = max(RESIDUAL_PER_M, RESIDUAL_M * float(np.median(inverse)) ** 2)
        plane, share = _ransac(rays, inverse, reach, rng)
        if share >= MIN_SHARE:
            break
    else:
        raise PerceptionError(
            f"no table: the largest plane holds {100 * share:.0f} % of the depth pixels; "
            f"at least {100 * MIN_SHARE:.0f} % are needed (do the intrinsics fit the camera?)"
        )
    plane, inliers = _refined(rays, inverse, plane, reach)
    size = float(np.linalg.norm(plane))
    height = (inverse - rays @ plane)[inliers] / inverse[inliers] / size
    normal = -plane / size
    normal.setflags(write=False)
    return TablePlane(
        normal=normal,
        distance_m=1 / size,
        rms_m=float(np.sqrt(np.mean(height**2))),
        share=share,
        pixels=int(np.count_nonzero(inliers)),
    )


def _places(depth: FloatArray, cloth: BoolArray | None) -> list[BoolArray]:
    """Where to look for the table, the best first: pixels with a depth around the cloth, then everywhere beside it."""
    wanted = (depth > 0) & (depth < np.inf)
    if cloth is not None and cloth.any():
        gap = cv2.distanceTransform((~cloth).astype(np.uint8), cv2.DIST_L2, 5)
        wanted &= gap > max(2, RIM_SHARE * cloth.shape[1])
        ring = wanted & (gap < RING_SHARE * math.sqrt(np.count_nonzero(cloth)))
        if np.count_nonzero(ring) >= MIN_POINTS:
            return [ring, wanted]
    if np.count_nonzero(wanted) < MIN_POINTS:
        raise PerceptionError(
            f"{np.count_nonzero(wanted)} pixels{'' if cloth is None else ' beside the cloth'} have a depth; "
            f"at least {MIN_POINTS} are needed to find the table"
        )
    return [wanted]


def _points(
    depth: FloatArray, lens: Intrinsics, wanted: BoolArray, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) slopes (u, v, 1) and (N,) 1/z of wanted pixels, in random order."""
    rows, columns = np.nonzero(wanted)
    drawn = rng.permutation(len(rows))[:FIT_POINTS]
    rows, columns = rows[drawn], columns[drawn]
    rays = np.column_stack([lens.slopes(rows, columns), np.ones(len(rows))])
    return rays, 1.0 / depth[rows, columns].astype(np.float64)


def _ransac(
    rays: NDArray[np.float64], inverse: NDArray[np.float64], reach: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], float]:
    """Plane m (3,), and the share of the points within ``reach`` of it."""
    from sklearn.linear_model import LinearRegression, RANSACRegressor  # slow to import

    few = slice(0, RANSAC_POINTS)
    search = RANSACRegressor(
        LinearRegression(fit_intercept=False),
        min_samples=3,
        residual_threshold=reach,
        is_model_valid=lambda model, _x, _y: _faces_camera(model.coef_),
        max_trials=MAX_TRIALS,
        stop_probability=0.9999,
        random_state=int(rng.integers(2**31)),
    )
    try:
        search.fit(rays[few], inverse[few])
    except ValueError as error:  # no trial was valid
        raise PerceptionError(
            f"no table: no plane in the depth image is seen at less than {MAX_TILT_DEG:.0f} degrees from straight above"
        ) from error
    return np.asarray(search.estimator_.coef_), float(np.mean(search.inlier_mask_))


def _faces_camera(plane: NDArray[np.float64]) -> bool:
    return bool(plane[2] > math.cos(math.radians(MAX_TILT_DEG)) * np.linalg.norm(plane))


def _refined(
    rays: NDArray[np.float64], inverse: NDArray[np.float64], plane: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], BoolArray]:
    """Least squares on the points within three times their own scatter, until these stay the same."""
    inliers = np.abs(inverse - rays @ plane) < reach
    for _ in range(10):
        plane = np.asarray(np.linalg.lstsq(rays[inliers], inverse[inliers], rcond=None)[0], dtype=np.float64)
        residual = np.abs(inverse - rays @ plane)
        scatter = max(1.4826 * float(np.median(residual[inliers])), STEP_PER_M)
        kept = residual < min(WIDEST * reach, 3 * scatter)
        if np.array_equal(kept, inliers):
            break
        inliers = kept
    return plane, inliers
