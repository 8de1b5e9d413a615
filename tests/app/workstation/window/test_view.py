"""The orbit camera, the drawn scene, the curves and the layout of the window."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace

import numpy as np
import pygame
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from layflat.app.workstation.playback import Playback
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.window import style
from layflat.app.workstation.window.curves import MIN_SPAN_S, draw_contact
from layflat.app.workstation.window.orbit_camera import OrbitCamera
from layflat.app.workstation.window.painter import fitting_scale, layout
from layflat.app.workstation.window.remote import BYTES_S, RemoteUpdates, changed_tiles, is_remote, prepare
from layflat.app.workstation.window.style import Canvas
from layflat.app.workstation.window.view3d import Scene, View3d
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.robots.hanger import PandaHanger
from layflat.sim.robots.panda import inverse_kinematics

SIZE = (640, 480)
orbits = st.builds(
    OrbitCamera, azimuth=st.floats(-3.1, 3.1), elevation=st.floats(0.1, 1.5), distance=st.floats(0.5, 3.5)
)
pixels = st.tuples(st.floats(0, SIZE[0]), st.floats(0, SIZE[1]))


@given(orbit=orbits, pixel=pixels, far=st.floats(0.2, 3.0))
def test_a_point_behind_a_pixel_is_seen_there(orbit, pixel, far):
    origin, direction = orbit.ray(pixel, SIZE)
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    seen, depth = orbit.project(origin + far * direction, SIZE)
    np.testing.assert_allclose(seen[0], pixel, atol=1e-6)
    assert 0 < depth[0] <= far + 1e-9


@given(orbit=orbits, pixel=pixels, by=st.tuples(st.floats(-80, 80), st.floats(-80, 80)))
def test_a_dragged_point_follows_the_mouse(orbit, pixel, by):
    origin, direction = orbit.ray(pixel, SIZE)
    point = origin + 0.8 * direction
    moved = orbit.dragged(point, *by, SIZE[1])
    seen, depth = orbit.project([point, moved], SIZE)
    np.testing.assert_allclose(seen[1] - seen[0], by, atol=1e-6)
    assert depth[1] == pytest.approx(depth[0])


@given(orbit=orbits, by=st.tuples(st.floats(-20, 20), st.floats(-20, 20)))
def test_the_target_stays_in_the_middle_and_pans_with_the_mouse(orbit, by):
    where, _ = orbit.project(orbit.target, SIZE)
    np.testing.assert_allclose(where[0], [SIZE[0] / 2, SIZE[1] / 2], atol=1e-6)
    panned = orbit.panned(*by, SIZE[1])
    if np.all(np.array(panned.target) > [-0.39, -0.69, 0.01]) and np.all(np.array(panned.target) < [0.99, 0.69, 0.69]):
        where, _ = panned.project(orbit.target, SIZE)
        np.testing.assert_allclose(where[0] - [SIZE[0] / 2, SIZE[1] / 2], by, atol=0.5)


def test_zooming_has_a_limit_and_turning_stays_above_the_table():
    orbit = OrbitCamera()
    assert orbit.zoomed(1).distance < orbit.distance < orbit.zoomed(-1).distance
    assert orbit.zoomed(1000).distance > 0.2
    assert orbit.turned(0, 10_000).eye()[2] > 0
    assert orbit.turned(0, -10_000).eye()[2] > 0
    assert orbit.turned(50, 0).turned(-50, 0) == orbit


def cloth_share(picture: np.ndarray) -> np.ndarray:
    """Return where the picture has colours of a cloth, which table, arm and hanger have not, (H, W)."""
    red, green, _ = (picture[..., k].astype(int) for k in range(3))
    return (np.abs(green - red) > 20) & (green > 60)


@pytest.mark.parametrize("name", ["towel", "napkin"])
def test_the_cloth_is_drawn_where_it_is(name):
    spec = cloth_spec(name)
    nodes = spec.flat_nodes()
    view = View3d(spec, None)
    orbit = OrbitCamera(elevation=1.2)
    below = Scene(nodes=nodes - [0, 0, 50])
    cloth = cloth_share(view.draw(Scene(nodes=nodes), orbit, SIZE)) & ~cloth_share(view.draw(below, orbit, SIZE))
    inner = nodes.reshape(spec.rows, spec.columns, 3)[1:-1, 1:-1].reshape(-1, 3)
    for x, y in np.rint(orbit.project(inner, SIZE)[0]).astype(int):
        assert cloth[y, x]
    # As large as it looks: the outline's area by the shoelace formula.
    corners = nodes.reshape(spec.rows, spec.columns, 3)[[0, -1, -1, 0], [0, 0, -1, -1]]
    x, y = orbit.project(corners, SIZE)[0].T
    area = abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2
    assert cloth.sum() == pytest.approx(area, rel=0.03)


def test_a_nearer_thing_hides_one_behind_it():
    """The arm hides a cloth behind it, and a cloth in front hides the arm."""
    spec = cloth_spec("towel")
    view = View3d(spec, PandaHanger.arm_shape(spec))
    joints = inverse_kinematics(np.array([0.2, 0.0, 0.3]))
    nodes = spec.flat_nodes() + np.array([0.1, 0.25, 0.4])
    shares = [
        cloth_share(
            view.draw(Scene(nodes=nodes, joints=joints), OrbitCamera(elevation=elevation, azimuth=-1.2), SIZE)
        ).sum()
        for elevation in (0.1, 1.3)
    ]
    alone = [
        cloth_share(view.draw(Scene(nodes=nodes), OrbitCamera(elevation=elevation, azimuth=-1.2), SIZE)).sum()
        for elevation in (0.1, 1.3)
    ]
    assert shares[0] < alone[0]
    assert shares[1] < alone[1]
    above = spec.flat_nodes() + np.array([0.1, 0.25, 1.3])
    from_above = OrbitCamera(elevation=1.5, target=(0.25, 0.25, 0.4), distance=2.5)
    hidden = [
        cloth_share(view.draw(s, from_above, SIZE)).sum()
        for s in (Scene(nodes=above, joints=joints), Scene(nodes=above))
    ]
    # Except for some pixels of the arm's foot at a corner.
    assert hidden[0] == pytest.approx(hidden[1], rel=2e-3)


@pytest.mark.parametrize("size", [(800, 600), (1280, 720), (1920, 1080), (3840, 2160), (400, 300)])
@given(heights=st.tuples(*[st.integers(10, 60)] * 2, st.integers(30, 75)))
def test_nothing_in_the_window_overlaps(size, heights):
    scale = fitting_scale(size, 2.0)
    facts, message, hints = (round(height * scale) for height in heights)
    place = layout(size, scale, facts=facts, message=message, hints=hints)
    areas = {name: area for name, area in vars(place).items() if name != "window"}
    for name, area in areas.items():
        assert place.window.contains(area), name
        assert area.height >= 4, name
    for (one, a), (other, b) in itertools.combinations(areas.items(), 2):
        assert not a.colliderect(b), f"{one} and {other}"


def human_band(series: TimeSeries, width: int = 300) -> list[bool]:
    """Return for the middle of each second whether the band of a person in control is drawn."""
    pygame.font.init()
    style.clear_cache()
    surface = pygame.Surface((width, 160))
    draw_contact(Canvas(surface), series)
    drawn = (pygame.surfarray.array3d(surface) == style.HUMAN).all(axis=2).any(axis=1)
    left, right = 44, width - 14  # Of the plot on its card.
    columns = [round(left + (s + 0.5) / MIN_SPAN_S * (right - left - 1)) for s in range(int(MIN_SPAN_S))]
    return drawn[columns].tolist()


@given(st.lists(st.booleans(), min_size=10, max_size=10))
@settings(max_examples=20, deadline=None)
def test_the_curves_show_when_a_person_was_in_control(human):
    """A step a second, so that each has its own place."""
    series = TimeSeries(
        episode=1, time_s=[float(s) for s in range(11)], contact=[0.5] * 11, angle_deg=[np.nan] * 11,
        phase=["place"] * 11, human=[False, *human],
    )  # fmt: skip
    assert human_band(series) == human


def test_a_replay_shows_when_a_person_was_in_control(lying, make_episode):
    episode = lying(make_episode(disturbed=False))
    marks = [False, True, True, False, False, True]
    steps = tuple(replace(step, intervention=mark) for step, mark in zip(episode.steps, marks, strict=True))
    shown = Playback("s.h5 demo_0", replace(episode, steps=steps))
    assert [shown.frame(k).human_in_control for k in range(7)] == [False, *marks]
    assert ["a person is in control" in shown.active_disturbances(k) for k in range(6)] == marks


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_a_remote_display_gets_all_that_has_changed_and_little_more(data):
    """Every pixel that differs is in one part, in no two, and in the area."""
    area = pygame.Rect(*data.draw(st.tuples(*[st.integers(0, 40)] * 2, *[st.integers(1, 150)] * 2)))
    before = np.zeros((200, 200), np.uint32)
    now = before.copy()
    places = data.draw(st.lists(st.tuples(*[st.integers(0, 199)] * 2), max_size=8))
    for x, y in places:
        now[x, y] = 7
    sent = np.zeros_like(now)
    for part in changed_tiles(now, before, area):
        assert area.contains(part)
        sent[part.left : part.right, part.top : part.bottom] += 1
    assert sent.max() <= 1
    inside = [(x, y) for x, y in places if area.collidepoint(x, y)]
    assert all(sent[x, y] for x, y in inside)
    assert sent.sum() <= 32 * 32 * len(places)


def test_a_remote_display_is_sent_no_more_than_it_takes():
    now = [0.0]
    updates, surface, sent = RemoteUpdates(lambda: now[0]), pygame.Surface((1000, 700)), 0
    for k in range(600):  # 20 s of a picture that changes whole.
        now[0] = k / 30
        if updates.has_room():
            surface.fill((k % 250, 0, 0))
            sent += sum(4 * part.width * part.height for part in updates.parts(surface, [surface.get_rect()]))
    assert 0.7 * BYTES_S < sent / 20 < 1.1 * BYTES_S
    now[0] += 10
    assert updates.has_room()
    assert updates.parts(surface, [surface.get_rect()]) == []
    updates.forget()
    assert updates.parts(surface, [surface.get_rect()]) == [surface.get_rect()]


@pytest.mark.parametrize(
    ("display", "remote"),
    [(":0", False), (":10.0", False), ("unix:0", False), ("", False), ("/private/tmp/x:0", False),
     ("localhost:10.0", True), ("host:0", True), ("tcp/host:1.0", True)],
)  # fmt: skip
def test_a_forwarded_display_is_remote(monkeypatch, display, remote):
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("SDL_FRAMEBUFFER_ACCELERATION", raising=False)
    assert is_remote() == remote
    prepare()
    assert os.environ.get("SDL_FRAMEBUFFER_ACCELERATION") == ("0" if remote else None), "other displays need it"
