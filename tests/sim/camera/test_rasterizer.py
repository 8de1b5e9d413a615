"""The z-buffer against projective geometry; against TinyRenderer in test_view.py."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.camera.rasterizer import rasterize

WIDTH, HEIGHT = 64, 48


def _square(u: float, v: float, size: float, depth: float) -> np.ndarray:
    return np.array([[u, v, depth], [u + size, v, depth], [u + size, v + size, depth], [u, v + size, depth]])


SQUARE_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def test_square_covers_the_pixel_centres_inside_it() -> None:
    raster = rasterize(_square(9.5, 4.5, 20, 1.0), SQUARE_TRIANGLES, WIDTH, HEIGHT)
    rows, columns = np.divmod(raster.pixels, WIDTH)
    assert len(raster.pixels) == 20 * 20
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (5, 24, 10, 29)


def test_no_pixel_twice_and_neighbouring_triangles_leave_no_gap() -> None:
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.linspace(-5, 70, 9), np.linspace(-5, 55, 7)), axis=-1).reshape(-1, 2)
    screen = np.column_stack([grid + rng.uniform(-2, 2, grid.shape), np.full(len(grid), 1.0)])
    cells = [(i * 9 + j, i * 9 + j + 1, i * 9 + j + 10, i * 9 + j + 9) for i in range(6) for j in range(8)]
    triangles = np.array([t for a, b, c, d in cells for t in ((a, b, c), (a, c, d))])
    raster = rasterize(screen, triangles, WIDTH, HEIGHT)
    assert np.array_equal(raster.pixels, np.arange(WIDTH * HEIGHT))


def test_depth_is_that_of_the_plane() -> None:
    # A plane z = 1 + 0.4 X + 0.7 Y seen through f = 50 px, centre (30, 20): z = 1 / (1 - 0.4 x - 0.7 y), x = X / z.
    focal, centre = 50.0, np.array([30.0, 20.0])
    uv = np.array([[3.0, 2.0], [60.0, 8.0], [35.0, 45.0]])

    def plane(pixels: np.ndarray) -> np.ndarray:
        x, y = ((pixels - centre) / focal).T
        return np.asarray(1 / (1 - 0.4 * x - 0.7 * y))

    raster = rasterize(np.column_stack([uv, plane(uv)]), np.array([[0, 1, 2]]), WIDTH, HEIGHT)
    rows, columns = np.divmod(raster.pixels, WIDTH)
    assert len(raster.pixels) > 300
    np.testing.assert_allclose(raster.depth, plane(np.column_stack([columns, rows])), rtol=1e-5)


@pytest.mark.parametrize("swapped", [False, True])
def test_nearest_triangle_wins_whatever_the_order(swapped: bool) -> None:
    near, far = _square(10.5, 10.5, 10, 0.8), _square(5.5, 5.5, 25, 1.2)
    first, second = (near, far) if swapped else (far, near)
    both = np.concatenate([SQUARE_TRIANGLES, SQUARE_TRIANGLES + 4])
    raster = rasterize(np.concatenate([first, second]), both, WIDTH, HEIGHT)
    assert (raster.depth < 1).sum() == 10 * 10
    assert len(raster.pixels) == 25 * 25


def test_facing_follows_the_order_of_the_corners() -> None:
    square = _square(5.5, 5.5, 20, 1.0)
    # Column to the right, row down: these corners run clockwise to the eye.
    assert not rasterize(square, SQUARE_TRIANGLES, WIDTH, HEIGHT).facing.any()
    assert rasterize(square, SQUARE_TRIANGLES[:, ::-1], WIDTH, HEIGHT).facing.all()


def test_interpolation_reproduces_a_linear_function_of_the_pixel() -> None:
    screen = np.array([[4.0, 3.0, 1.0], [58.0, 10.0, 1.0], [30.0, 44.0, 1.0]])
    triangles = np.array([[0, 1, 2]])
    raster = rasterize(screen, triangles, WIDTH, HEIGHT)
    values = screen[:, :2] @ [0.3, -0.7] + 2
    rows, columns = np.divmod(raster.pixels, WIDTH)
    np.testing.assert_allclose(raster.interpolate(values, triangles), 0.3 * columns - 0.7 * rows + 2, atol=1e-4)


def test_nothing_is_drawn_behind_the_camera_or_beside_the_image() -> None:
    for square in (_square(10, 10, 10, -1.0), _square(200, 10, 10, 1.0), _square(-50, -50, 10, 1.0)):
        assert len(rasterize(square, SQUARE_TRIANGLES, WIDTH, HEIGHT).pixels) == 0
