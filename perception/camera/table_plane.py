"""Table plane fitted to a depth image, and the camera pose that follows from it: the stand need not be measured.

A plane m . P = 1 in camera axes is, since P = z (u, v, 1), the linear function 1/z = m . (u, v, 1) of the ray's slopes
u and v at every tilt. A stereo camera's error is constant in disparity, and so in 1/z: near and far pixels count alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, Float64Array, FloatArray
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.errors import PerceptionError

RESIDUAL_PER_M = 0.008
"""A pixel whose 1/z is farther than this from the plane is not table: 8 mm at 1 m, three times a D435's noise."""
RESIDUAL_M = 0.005
"""At short range, where noise is small, a table may still be bent by this much, in fact or by the sensor's errors."""
MAX_WIDENING = 3.0
"""The final fit takes pixels as far away as this times the above, if they scatter so."""
MIN_POINTS = 400
MIN_SHARE = 0.2
"""Smallest share of the pixels on the plane; a table alone in the image has more than 0.9."""
MAX_TILT_DEG = 80.0
"""Beyond this tilt the table is seen edge on."""
RIM_SHARE = 0.01
"""Excluded rim around the cloth, share of the image width: its edge lifts its neighbours' depth."""
RING_SHARE = 0.3
"""Width of the ring around the cloth, share of the cloth's side."""
RANSAC_POINTS, FIT_POINTS = 4000, 80_000
"""Random pixels that the trials and the final fit use."""
MAX_TRIALS = 1500
"""Three random points lie on a plane with MIN_SHARE of the pixels in 1 of 125 trials."""
STEP_PER_M = 0.0005
"""Half the step of a depth in whole millimetres at 1 m, in 1/z: smaller residuals mean nothing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TablePlane:
    """Table plane in camera axes (x right, y down, z forward)."""

    normal: Float64Array
    """(3,) unit vector from the table towards the camera."""
    distance_m: float
    """Distance from the camera to the plane, along the normal."""
    rms_m: float
    """Scatter of the depth pixels about the plane, along the normal, without outliers."""
    inlier_share: float
    """Share of the depth pixels beside the cloth that lie on the plane, 0..1."""
    n_inliers: int
    """Number of depth pixels in the final fit."""

    @property
    def tilt_deg(self) -> float:
        """Angle between the optical axis and the table's normal; 0 looks straight down."""
        return math.degrees(math.acos(min(1.0, -float(self.normal[2]))))

    def camera(self, intrinsics: Intrinsics) -> PinholeCamera:
        """Return the camera over this table, with the world's origin on the table below it.

        x is the image's right, projected on the table; y, at a right angle to x, points to the image's top. Directions
        in table coordinates are then the image's, without the foreshortening of a tilted view.
        """
        right = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(self.normal, right), self.normal])
        pose[2, 3] = self.distance_m
        return intrinsics.camera_at(pose)


def fit_table_plane(
    depth: FloatArray, intrinsics: Intrinsics, *, rng: np.random.Generator, cloth: BoolArray | None = None
) -> TablePlane:
    """Fit the table's plane to ``depth`` (H, W): RANSAC (scikit-learn's), then least squares on the inliers.

    The pixels of ``cloth`` (H, W) are left out and a ring around them is preferred, so that a larger floor is not taken
    for the table and a sensor's bent field of depth matters less. ``rng`` draws pixels and trials. PerceptionError if
    there are too few depth pixels, or no plane holds MIN_SHARE of them.
    """
    if depth.shape != (intrinsics.height, intrinsics.width):
        raise PerceptionError(
            f"depth has shape {depth.shape}; this camera's images are {(intrinsics.height, intrinsics.width)}"
        )
    for candidates in _candidate_masks(depth, cloth):
        rays, inverse = _sample_rays(depth, intrinsics, candidates, rng)
        tolerance = max(RESIDUAL_PER_M, RESIDUAL_M * float(np.median(inverse)) ** 2)
        plane, share = _ransac(rays, inverse, tolerance, rng)
        if share >= MIN_SHARE:
            break
    else:
        raise PerceptionError(
            f"no table: the largest plane holds {100 * share:.0f} % of the depth pixels; "
            f"at least {100 * MIN_SHARE:.0f} % are needed (do the intrinsics fit the camera?)"
        )
    plane, inliers = _refine(rays, inverse, plane, tolerance)
    size = float(np.linalg.norm(plane))
    height = (inverse - rays @ plane)[inliers] / inverse[inliers] / size
    rms_m = float(np.sqrt(np.mean(height**2)))
    normal = -plane / size
    normal.setflags(write=False)
    return TablePlane(normal=normal, distance_m=1 / size, rms_m=rms_m, inlier_share=share, n_inliers=len(height))


def _candidate_masks(depth: FloatArray, cloth: BoolArray | None) -> list[BoolArray]:
    """Return where to look for the table, best first: valid depth around the cloth, then everywhere beside it."""
    valid = (depth > 0) & (depth < np.inf)
    if cloth is not None and cloth.any():
        gap = cv2.distanceTransform((~cloth).astype(np.uint8), cv2.DIST_L2, 5)
        valid &= gap > max(2, RIM_SHARE * cloth.shape[1])
        ring = valid & (gap < RING_SHARE * math.sqrt(np.count_nonzero(cloth)))
        if np.count_nonzero(ring) >= MIN_POINTS:
            return [ring, valid]
    if np.count_nonzero(valid) < MIN_POINTS:
        raise PerceptionError(
            f"{np.count_nonzero(valid)} pixels{'' if cloth is None else ' beside the cloth'} have a depth; "
            f"at least {MIN_POINTS} are needed to find the table"
        )
    return [valid]


def _sample_rays(
    depth: FloatArray, intrinsics: Intrinsics, mask: BoolArray, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Return (N, 3) slopes (u, v, 1) and (N,) 1/z of pixels of ``mask``, in random order."""
    rows, columns = np.nonzero(mask)
    drawn = rng.permutation(len(rows))[:FIT_POINTS]
    rows, columns = rows[drawn], columns[drawn]
    rays = np.column_stack([intrinsics.ray_slopes(rows, columns), np.ones(len(rows))])
    return rays, 1.0 / depth[rows, columns].astype(np.float64)


def _ransac(
    rays: Float64Array, inverse: Float64Array, tolerance: float, rng: np.random.Generator
) -> tuple[Float64Array, float]:
    """Return the plane m (3,) and the share of the points within ``tolerance`` of it."""
    from sklearn.linear_model import LinearRegression, RANSACRegressor  # slow to import

    few, min_cosine = slice(0, RANSAC_POINTS), math.cos(math.radians(MAX_TILT_DEG))
    search = RANSACRegressor(
        LinearRegression(fit_intercept=False),
        min_samples=3,
        residual_threshold=tolerance,
        is_model_valid=lambda model, _x, _y: bool(model.coef_[2] > min_cosine * np.linalg.norm(model.coef_)),
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


def _refine(
    rays: Float64Array, inverse: Float64Array, plane: Float64Array, tolerance: float
) -> tuple[Float64Array, BoolArray]:
    """Fit least squares to the points within three times their own scatter, until these stay the same."""
    inliers = np.abs(inverse - rays @ plane) < tolerance
    for _ in range(10):
        plane = np.asarray(np.linalg.lstsq(rays[inliers], inverse[inliers], rcond=None)[0], dtype=np.float64)
        residual = np.abs(inverse - rays @ plane)
        scatter = max(1.4826 * float(np.median(residual[inliers])), STEP_PER_M)
        kept = residual < min(MAX_WIDENING * tolerance, 3 * scatter)
        if np.array_equal(kept, inliers):
            break
        inliers = kept
    return plane, inliers
