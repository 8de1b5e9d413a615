"""Renderer: the image of one pinhole camera, with table, floor, cloth, shadow and balls.

The table and floor do not change, so they are computed once. The cloth comes from layflat.sim.camera.rasterizer. Solid
bodies (an arm with its hanger) are drawn over it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.sim.camera.rasterizer import Raster, fronts, rasterize
from layflat.sim.cloth.mesh import ClothMesh
from layflat.sim.conditions.keys import LIGHT_AZIMUTH_DEG, LIGHT_HEIGHT_DEG, Conditions
from layflat.sim.physics.base import FAR_M, NEAR_M, TABLE_CENTRE_M, TABLE_RGBA, TABLE_SIZE_M

LIGHT = np.array([1.0, 1.0, 1.15]) / np.linalg.norm([1.0, 1.0, 1.15])
"""Towards the light: 39 degrees high, between the axes, so that wrinkles along x and along y are shaded alike."""
AMBIENT, DIFFUSE = 0.30, 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Light:
    """The light that falls on table and cloth beside what the room sheds."""

    direction: FloatArray = field(default_factory=LIGHT.copy)
    """Unit vector towards the light, (3,), world."""
    strength: float = 1.0

    @property
    def table_brightness(self) -> float:
        """Brightness of the table and the floor, as a factor on that under the usual light."""
        shed = AMBIENT + self.strength * DIFFUSE * float(self.direction[2])
        return shed / (AMBIENT + DIFFUSE * float(LIGHT[2]))


def light_of(conditions: Conditions) -> Light:
    """Return the light of conditions."""
    azimuth, height, strength = (
        getattr(conditions, f"light_{name}") for name in ("azimuth_deg", "height_deg", "strength")
    )
    if (azimuth, height) == (LIGHT_AZIMUTH_DEG, LIGHT_HEIGHT_DEG):
        return Light(strength=strength)
    turn, rise = np.radians([azimuth, height])
    level = np.cos(rise)
    return Light(direction=np.array([level * np.cos(turn), level * np.sin(turn), np.sin(rise)]), strength=strength)


USUAL_LIGHT = Light()
SOLID_AMBIENT, SOLID_DIFFUSE = 0.60, 0.35
FACE_RGB = (40.0, 90.0, 200.0)
REVERSE_RGB = (48.0, 116.0, 196.0)
"""A slightly different blue: a fold is visible, and one range of hue takes both."""
FLOOR_RGB = (118.0, 112.0, 106.0)
SKY_RGB = (176.0, 180.0, 186.0)
FLOOR_Z_M = -0.75
SHADOW = 0.72
"""Brightness of the table in the cloth's shadow."""


@dataclass(kw_only=True)
class Framebuffer:
    """An image under construction, pixels in one row."""

    rgb: NDArray[np.uint8]
    """(H * W, 3)"""
    depth: NDArray[np.float32]
    """(H * W,) m along the optical axis; inf where there is nothing."""

    def put(self, pixels: NDArray[np.intp], depth: NDArray[np.float32], rgb: NDArray) -> None:
        """Draw what is nearer than the image so far."""
        nearer = depth < self.depth[pixels]
        drawn = pixels[nearer]
        self.depth[drawn] = depth[nearer]
        self.rgb[drawn] = np.clip(rgb[nearer], 0, 255)


class Renderer:
    """Image of the table and the cloth before one pinhole."""

    def __init__(self, pinhole: PinholeCamera, light: Light = USUAL_LIGHT) -> None:
        self.pinhole, self.light = pinhole, light
        self._world_to_cam = np.ascontiguousarray(pinhole.cam_to_world[:3, :3])
        self._background = _background(pinhole, light.table_brightness)

    def background(self) -> Framebuffer:
        """Return an image of table and floor."""
        return Framebuffer(rgb=self._background.rgb.copy(), depth=self._background.depth.copy())

    def raster(self, vertices: FloatArray, triangles: NDArray) -> Raster:
        """Return which pixels see which of the triangles (T, 3) over vertices (V, 3) m, world."""
        return rasterize(self._screen(vertices), triangles, self.pinhole.width, self.pinhole.height)

    def _screen(self, vertices: FloatArray) -> FloatArray:
        return np.column_stack(self.pinhole.project(vertices))

    def draw_cloth(self, picture: Framebuffer, mesh: ClothMesh) -> None:
        """Draw the cloth, each side in its colour, shaded by its smooth normals."""
        raster = self.raster(mesh.vertices, mesh.triangles)
        slope = raster.interpolate(mesh.normals @ self.light.direction, mesh.triangles)
        # The light falls on the side that the camera sees.
        bright = AMBIENT + self.light.strength * DIFFUSE * np.maximum(np.where(raster.facing, slope, -slope), 0.0)
        base = np.where(raster.facing[:, None], FACE_RGB, REVERSE_RGB).astype(np.float32)
        picture.put(raster.pixels, raster.depth, base * bright[:, None])

    def draw_solid(self, picture: Framebuffer, vertices: FloatArray, triangles: NDArray, colours: FloatArray) -> None:
        """Draw a closed body of flat triangles; see `layflat.sim.physics.base.Solid` for its arrays."""
        screen, size = self._screen(vertices), (self.pinhole.width, self.pinhole.height)
        faces = fronts(screen, triangles, *size)
        raster = rasterize(screen, triangles[faces], *size)
        corners = vertices[triangles[faces]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        slope = normals @ self.light.direction / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
        bright = SOLID_AMBIENT + SOLID_DIFFUSE * np.maximum(slope, 0.0)
        picture.put(raster.pixels, raster.depth, (colours[faces] * bright[:, None])[raster.triangles])

    def draw_ball(
        self, picture: Framebuffer, centre: FloatArray, radius_m: float, rgb: tuple[float, float, float]
    ) -> None:
        """Draw a shaded ball, for a picker that has no body to show."""
        pixel, depth = self.pinhole.project(centre)
        if depth[0] <= NEAR_M:
            return
        radius = radius_m * self.pinhole.fx / depth[0]
        row, column = np.mgrid[-int(radius) - 1 : int(radius) + 2, -int(radius) - 1 : int(radius) + 2]
        inside = np.hypot(row, column) <= radius
        dx, dy = column[inside] / radius, row[inside] / radius
        dz = np.sqrt(1 - dx**2 - dy**2)
        u, v = (np.rint(pixel[0]).astype(int)[:, None] + (column[inside], row[inside])).astype(int)
        kept = (u >= 0) & (u < self.pinhole.width) & (v >= 0) & (v < self.pinhole.height)
        normal = np.stack([dx, dy, -dz], axis=1) @ self._world_to_cam.T
        bright = AMBIENT + self.light.strength * DIFFUSE * np.maximum(normal @ self.light.direction, 0.0)
        nearest = (depth[0] - dz * radius_m).astype(np.float32)
        colours = bright[:, None] * np.array(rgb)
        picture.put((v * self.pinhole.width + u)[kept], nearest[kept], colours[kept])

    def draw_shadow(self, picture: Framebuffer, mesh: ClothMesh) -> None:
        """Darken the table where the cloth stands between it and the light; call before anything else is drawn."""
        light = self.light.direction
        shadow = mesh.vertices - mesh.vertices[:, 2:] / light[2] * light
        pixels = self.raster(shadow, mesh.triangles).pixels
        on_table = pixels[self._background.on_table[pixels]]
        picture.rgb[on_table] = (picture.rgb[on_table] * SHADOW).astype(np.uint8)


@dataclass(kw_only=True)
class _Background(Framebuffer):
    on_table: NDArray[np.bool_]


@lru_cache(maxsize=4)
def _background(pinhole: PinholeCamera, brightness: float) -> _Background:
    """Draw the table as a box and the floor below, by intersecting each pixel's ray with them."""
    size = pinhole.width * pinhole.height
    row, column = np.divmod(np.arange(size), pinhole.width)
    local = np.stack([(column - pinhole.cx) / pinhole.fx, (row - pinhole.cy) / pinhole.fy, np.ones(size)], axis=1)
    # With the third component 1, the parameter along a ray is the depth along the optical axis.
    rays = local @ pinhole.cam_to_world[:3, :3].T
    rays[rays == 0.0] = 1e-12
    half = np.array(TABLE_SIZE_M) / 2
    centre = np.array([*TABLE_CENTRE_M, -half[2]])
    ends = ((centre - half - pinhole.position) / rays, (centre + half - pinhole.position) / rays)
    enter_axes = np.minimum(*ends)
    enter, leave = enter_axes.max(axis=1), np.maximum(*ends).min(axis=1)
    on_box = (enter > 0) & (enter < leave)
    axis = enter_axes.argmax(axis=1)
    floor = (FLOOR_Z_M - pinhole.position[2]) / rays[:, 2]

    rgb = np.tile(np.array(SKY_RGB), (size, 1))
    depth = np.full(size, np.inf)
    on_floor = (floor > 0) & (floor < FAR_M)
    rgb[on_floor], depth[on_floor] = FLOOR_RGB, floor[on_floor]
    table = 255.0 * np.array(TABLE_RGBA[:3])
    rgb[on_box] = table * np.array([0.78, 0.70, 1.0])[axis[on_box], None]
    depth[on_box] = enter[on_box]
    return _Background(
        rgb=np.minimum(brightness * rgb, 255.0).astype(np.uint8),
        depth=depth.astype(np.float32),
        on_table=on_box & (axis == 2),
    )
