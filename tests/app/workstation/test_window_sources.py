"""Keys and mouse in a window, as pygame's events tell of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.app.workstation.teleop import Teleoperator, WindowTeleoperator, key_map, sdl
from layflat.app.workstation.teleop.combined_input import CombinedInput
from layflat.app.workstation.teleop.hand_guiding import GRASP_M, HandGuidingTeleoperator, take_hold
from layflat.app.workstation.teleop.mouse import REACH_PX, Mouse
from layflat.app.workstation.teleop.registry import TELEOPERATORS, terminal_source, window_source
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.window_keyboard import WindowKeyboard
from layflat.app.workstation.window.orbit_camera import OrbitCamera
from layflat.data.errors import DataError
from layflat.data.types import ACTION_LIMIT_M
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.tests.app.workstation.conftest import HandSource

sdl.start()
import pygame  # noqa: E402  # SDL reads its settings when pygame is loaded.

CORNERS = np.array([[0.1, 0.175, 0.4], [0.1, -0.175, 0.4]])
SIZE = (800, 600)
VIEW = OrbitCamera()


def ray(pixel: tuple[int, int]):
    return VIEW.ray(pixel, SIZE)


def pixel_of(point) -> tuple[int, int]:
    (place,), _ = VIEW.project(np.array([point]), SIZE)
    return round(float(place[0])), round(float(place[1]))


def key(kind: int, code: int, mod: int = 0) -> pygame.event.Event:
    return pygame.event.Event(kind, key=code, mod=mod, unicode="")


def mouse(kind: int, pos: tuple[int, int], button: int = 1) -> pygame.event.Event:
    return pygame.event.Event(kind, pos=pos, button=button)


@pytest.fixture(params=[(name, robot) for name in TELEOPERATORS for robot in ROBOTS], ids="-".join)
def any_source(request):
    name, robot = request.param
    made = window_source(name, robot, ray=ray, corners=lambda: CORNERS)
    yield made, name, robot
    made.close()
    made.close()


def test_every_source_of_the_window_is_one(any_source):
    source, name, robot = any_source
    assert isinstance(source, Teleoperator)
    assert isinstance(source, WindowTeleoperator)
    assert source.name == name
    reading = source.poll()
    assert reading.motion.shape == (robot_spec(robot).size,)
    assert not reading.moving
    assert {button.control for button in source.help()} >= set(Command)
    assert any(button.control is None for button in source.help())
    source.rumble(0.5, 0.1)
    assert not source.on_event(pygame.event.Event(pygame.WINDOWEXPOSED))


def test_every_source_has_the_controls_of_the_keyboard_but_the_pad(any_source):
    source, name, _ = any_source
    source.on_event(key(pygame.KEYDOWN, pygame.K_RETURN))
    source.on_event(key(pygame.KEYDOWN, pygame.K_y))
    expected = () if name == "gamepad" else (Command.START, Command.KEEP_SUCCESS)
    assert source.poll().controls == expected
    assert source.poll().controls == ()


def test_keys_are_held_together_until_they_come_up():
    one = WindowKeyboard("hanger")
    one.on_event(key(pygame.KEYDOWN, pygame.K_d))
    one.on_event(key(pygame.KEYDOWN, pygame.K_DOWN))
    assert one.poll().motion.tolist() == [1.0, -1.0]
    assert one.poll().motion.tolist() == [1.0, -1.0]
    one.on_event(key(pygame.KEYUP, pygame.K_d))
    assert one.poll().motion.tolist() == [0.0, -1.0]
    one.on_event(pygame.event.Event(pygame.WINDOWFOCUSLOST))
    assert not one.poll().moving


def test_letting_go_of_shift_first_leaves_no_key_held():
    one = WindowKeyboard("pickers")
    one.on_event(key(pygame.KEYDOWN, pygame.K_a, pygame.KMOD_LSHIFT))
    assert (one.poll().motion.reshape(2, 3)[1] == [0, -1, 0]).all()  # The left picker, to the left: -y.
    one.on_event(key(pygame.KEYUP, pygame.K_a))
    assert not one.poll().moving


def test_shortcuts_of_the_window_are_not_the_keyboard_s():
    one = WindowKeyboard("hanger")
    assert not one.on_event(key(pygame.KEYDOWN, pygame.K_q, pygame.KMOD_LCTRL))
    assert not one.on_event(key(pygame.KEYDOWN, pygame.K_F1))
    assert one.poll().controls == ()


def test_every_key_of_the_help_is_known_in_the_window():
    codes = {"enter": pygame.K_RETURN, "space": pygame.K_SPACE}
    for robot in ROBOTS:
        for name in (*key_map.key_motions(robot), *key_map.CONTROLS):
            plain = name.removeprefix("shift-")
            shift = pygame.KMOD_LSHIFT if name != plain or name.isupper() else 0
            one = WindowKeyboard(robot)
            assert one.on_event(key(pygame.KEYDOWN, codes.get(name) or pygame.key.key_code(plain.lower()), shift))
            reading = one.poll()
            if name in key_map.CONTROLS:
                assert reading.controls == (key_map.CONTROLS[name],)
            else:
                assert (reading.motion == key_map.key_motions(robot)[name]).all()


@given(st.integers(-400, 400), st.integers(-400, 400))
def test_a_drag_is_a_joystick(dx, dy):
    one = Mouse("hanger")
    one.on_event(mouse(pygame.MOUSEBUTTONDOWN, (500, 500)))
    one.on_event(mouse(pygame.MOUSEMOTION, (500 + dx, 500 + dy)))
    motion = one.poll().motion
    assert np.linalg.norm(motion) <= 1 + 1e-9
    assert motion @ [dx, -dy] >= 0
    assert motion @ [dy, dx] == pytest.approx(0, abs=1e-6)
    if np.hypot(dx, dy) >= REACH_PX:
        assert np.linalg.norm(motion) == pytest.approx(1.0)
    one.on_event(mouse(pygame.MOUSEBUTTONUP, (0, 0)))
    assert not one.poll().moving


@pytest.mark.parametrize(
    ("mod", "expected"),
    [
        (0, [[1, 0, 0], [1, 0, 0]]),
        (pygame.KMOD_LSHIFT, [[0, 1, 0], [0, 1, 0]]),
        (pygame.KMOD_LCTRL, [[0, 0, 0], [1, 0, 0]]),  # The left one is picker 2.
        (pygame.KMOD_LALT, [[1, 0, 0], [0, 0, 0]]),
    ],
)
def test_modifiers_choose_pickers_and_axis(mod, expected):
    one = Mouse("pickers")
    pygame.key.set_mods(mod)
    try:
        one.on_event(mouse(pygame.MOUSEBUTTONDOWN, (100, 100)))
        one.on_event(mouse(pygame.MOUSEMOTION, (500, 100)))
        assert one.poll().motion.reshape(2, 3).tolist() == expected
    finally:
        pygame.key.set_mods(0)


def test_other_buttons_of_the_mouse_are_the_view_s():
    for one in (Mouse("hanger"), HandGuidingTeleoperator("hanger", ray, lambda: CORNERS)):
        assert not one.on_event(mouse(pygame.MOUSEBUTTONDOWN, (100, 100), button=3))
        assert not one.on_event(mouse(pygame.MOUSEMOTION, (200, 100)))
        assert not one.poll().moving


def led(robot: str, start, to) -> TeleopInput:
    one = HandGuidingTeleoperator(robot, ray, lambda: CORNERS)
    assert one.on_event(mouse(pygame.MOUSEBUTTONDOWN, pixel_of(start)))
    one.on_event(mouse(pygame.MOUSEMOTION, pixel_of(to)))
    return one.poll()


@given(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.sampled_from([-0.1, 0.0, 0.15]))
def test_the_hanger_follows_the_hand_in_its_plane(dx, dz, at_y):
    """Wherever on the bar it is taken hold of: to a pixel or two."""
    start = np.array([0.1, at_y, 0.4])
    reading = led("hanger", start, start + np.array([dx, 0.0, dz]))
    assert reading.hand == pytest.approx(np.array([0.1 + dx, 0.0, 0.4 + dz]), abs=0.012)
    assert reading.moving


@given(st.integers(0, 1), st.integers(-80, 80), st.integers(-80, 80))
def test_a_picker_follows_under_the_mouse_and_neither_near_nor_far_and_the_other_stays(which, dx, dy):
    start = pixel_of(CORNERS[which])
    one = HandGuidingTeleoperator("pickers", ray, lambda: CORNERS)
    one.on_event(mouse(pygame.MOUSEBUTTONDOWN, start))
    one.on_event(mouse(pygame.MOUSEMOTION, (start[0] + dx, start[1] + dy)))
    hand = one.poll().hand
    (seen,), _ = VIEW.project(hand[which], SIZE)
    assert seen == pytest.approx([start[0] + dx, start[1] + dy], abs=1.0)
    level = ray(start)[1] * [1, 1, 0]
    assert (hand[which] - CORNERS[which]) @ level == pytest.approx(0.0, abs=1e-9)
    assert (hand[1 - which] == CORNERS[1 - which]).all()


def test_a_press_holds_without_a_jump_and_letting_go_ends_it():
    one = HandGuidingTeleoperator("hanger", ray, lambda: CORNERS)
    one.on_event(mouse(pygame.MOUSEBUTTONDOWN, pixel_of([0.1, 0.1, 0.4])))
    assert one.poll().hand == pytest.approx(np.array([0.1, 0.0, 0.4]))
    one.on_event(mouse(pygame.MOUSEBUTTONUP, (0, 0)))
    assert one.poll().hand is None


def test_nothing_is_held_beside_the_hanger_or_before_it_is_there():
    origin, direction = ray(pixel_of([0.1, 0.0, 0.4 + 3 * GRASP_M]))
    for robot in ROBOTS:
        assert take_hold(robot, CORNERS, origin, direction) is None
        assert take_hold(robot, np.full((2, 3), np.inf), origin, direction) is None


def test_seen_edge_on_the_hanger_can_still_be_led():
    origin, direction = np.array([3.0, 0.0, 0.4]), np.array([-1.0, 0.0, 0.0])
    hold = take_hold("hanger", CORNERS, origin, direction)
    assert hold is not None
    hold.lead(origin, np.array([-1.0, 0.05, 0.1]))
    assert hold.hand[2] > 0.5
    assert hold.hand[1] == 0.0


def test_a_pad_beside_keys_obeys_both():
    pad, board = HandSource(), HandSource()
    pad.motion = np.array([1.0, 0.0])
    board.motion = np.array([0.0, 1.0])
    both = CombinedInput(pad, board)
    pad.controls, board.controls = [Command.START], [Command.QUIT]
    reading = both.poll()
    assert reading.controls == (Command.START, Command.QUIT)
    assert reading.motion.tolist() == [1.0, 0.0]
    pad.connected = False
    board.controls = [Command.QUIT]
    gone = both.poll()
    assert (gone.connected, gone.controls) == (False, (Command.QUIT,))
    assert isinstance(both, Teleoperator)


def test_sources_of_the_terminal_are_those_that_say_so():
    made: dict[str, Callable] = {name: terminal_source for name, kind in TELEOPERATORS.items() if kind.terminal}
    assert set(made) == {"gamepad", "keyboard"}


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=2), st.floats(0, 1))
def test_an_action_stays_within_what_files_take(motion, speed):
    reading = TeleopInput(motion=np.array(motion), speed=speed)
    assert np.abs(reading.action).max() <= ACTION_LIMIT_M
    assert reading.moving == (speed > 0 and any(motion))


@pytest.mark.parametrize(
    "wrong",
    [
        {"motion": np.array([1.1, 0.0])},
        {"motion": np.array([np.nan, 0.0])},
        {"motion": np.zeros((2, 3))},
        {"speed": 1.5},
        {"speed": float("nan")},
        {"hand": np.zeros(2)},
    ],
    ids=str,
)
def test_a_reading_that_cannot_be_is_refused(wrong):
    with pytest.raises(DataError):
        TeleopInput(**({"motion": np.zeros(2)} | wrong))
    assert TeleopInput(motion=np.zeros(2)).after(TeleopInput(motion=np.ones(2), controls=(Command.QUIT,))).controls == (
        Command.QUIT,
    )
