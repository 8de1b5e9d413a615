"""Keys and mouse in a window, by pygame's events."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.app.workstation.teleop import keyboard, sdl
from layflat.app.workstation.teleop.keyboard import WindowKeyboard
from layflat.app.workstation.teleop.mouse import GRAB_M, REACH_PX, HandGuidingTeleoperator, Mouse, grab
from layflat.app.workstation.teleop.registry import TELEOPERATORS, make_window_teleoperator
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import CombinedInput, Teleoperator, WindowTeleoperator
from layflat.app.workstation.window.orbit_camera import OrbitCamera
from layflat.data.errors import DataError
from layflat.data.types import ACTION_LIMIT_M
from layflat.tests.app.workstation.fakes import FakeTeleoperator
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS

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


@pytest.fixture(params=[(n, r) for n in TELEOPERATORS for r in ROBOT_SPECS], ids=lambda p: "-".join(map(str, p)))
def any_source(request):
    name, robot = request.param
    made = make_window_teleoperator(name, robot, ray=ray, corners=lambda: CORNERS)
    yield made, name, robot
    made.close()
    made.close()


def test_every_teleoperator_of_the_window_is_one(any_source):
    source, name, robot = any_source
    assert isinstance(source, Teleoperator)
    assert isinstance(source, WindowTeleoperator)
    assert source.name == name
    reading = source.poll()
    assert reading.motion.shape == (robot.size,)
    assert not reading.moving
    assert {button.command for button in source.help()} >= set(Command)
    assert any(button.command is None for button in source.help())
    source.rumble(0.5, 0.1)
    assert not source.on_event(pygame.event.Event(pygame.WINDOWEXPOSED))


def test_all_but_the_gamepad_have_the_keyboards_commands(any_source):
    source, name, _ = any_source
    source.on_event(key(pygame.KEYDOWN, pygame.K_RETURN))
    source.on_event(key(pygame.KEYDOWN, pygame.K_y))
    expected = () if name == "gamepad" else (Command.START, Command.KEEP_SUCCESS)
    assert source.poll().commands == expected
    assert source.poll().commands == ()


def test_keys_are_held_together_until_they_come_up():
    one = WindowKeyboard(HANGER)
    one.on_event(key(pygame.KEYDOWN, pygame.K_d))
    one.on_event(key(pygame.KEYDOWN, pygame.K_DOWN))
    assert one.poll().motion.tolist() == [1.0, -1.0]
    one.release_taps(time.monotonic())  # A step has acted.
    assert one.poll().motion.tolist() == [1.0, -1.0]
    one.on_event(key(pygame.KEYUP, pygame.K_d))
    assert one.poll().motion.tolist() == [0.0, -1.0]
    one.on_event(key(pygame.KEYDOWN, pygame.K_UP))
    assert not one.poll().motion.any(), "up and down"
    one.on_event(pygame.event.Event(pygame.WINDOWFOCUSLOST))
    assert not one.poll().moving


def test_releasing_shift_first_leaves_no_key_held():
    one = WindowKeyboard(PICKERS)
    one.on_event(key(pygame.KEYDOWN, pygame.K_a, pygame.KMOD_LSHIFT))
    assert (one.poll().motion.reshape(2, 3)[1] == [0, -1, 0]).all()  # The left picker, to the left: -y.
    one.on_event(key(pygame.KEYUP, pygame.K_a))
    one.release_taps(time.monotonic())
    assert not one.poll().moving


def test_shortcuts_are_left_to_the_window():
    one = WindowKeyboard(HANGER)
    assert not one.on_event(key(pygame.KEYDOWN, pygame.K_q, pygame.KMOD_LCTRL))
    assert not one.on_event(key(pygame.KEYDOWN, pygame.K_F1))
    assert one.poll().commands == ()


def test_every_key_of_the_help_is_known_in_the_window():
    codes = {"enter": pygame.K_RETURN, "space": pygame.K_SPACE}
    for robot in ROBOT_SPECS:
        for name in (*keyboard.key_motions(robot), *keyboard.COMMANDS):
            plain = name.removeprefix("shift-")
            shift = pygame.KMOD_LSHIFT if name != plain or name.isupper() else 0
            one = WindowKeyboard(robot)
            assert one.on_event(key(pygame.KEYDOWN, codes.get(name) or pygame.key.key_code(plain.lower()), shift))
            reading = one.poll()
            if name in keyboard.COMMANDS:
                assert reading.commands == (keyboard.COMMANDS[name],)
            else:
                assert (reading.motion == keyboard.key_motions(robot)[name]).all()


@given(st.integers(-400, 400), st.integers(-400, 400))
def test_a_drag_is_a_joystick(dx, dy):
    one = Mouse(HANGER)
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
    one = Mouse(PICKERS)
    pygame.key.set_mods(mod)
    try:
        one.on_event(mouse(pygame.MOUSEBUTTONDOWN, (100, 100)))
        one.on_event(mouse(pygame.MOUSEMOTION, (500, 100)))
        assert one.poll().motion.reshape(2, 3).tolist() == expected
    finally:
        pygame.key.set_mods(0)


def test_other_mouse_buttons_are_left_to_the_view():
    for one in (Mouse(HANGER), HandGuidingTeleoperator(HANGER, ray, lambda: CORNERS)):
        assert not one.on_event(mouse(pygame.MOUSEBUTTONDOWN, (100, 100), button=3))
        assert not one.on_event(mouse(pygame.MOUSEMOTION, (200, 100)))
        assert not one.poll().moving


def guided(robot, start, to) -> TeleopInput:
    one = HandGuidingTeleoperator(robot, ray, lambda: CORNERS)
    assert one.on_event(mouse(pygame.MOUSEBUTTONDOWN, pixel_of(start)))
    one.on_event(mouse(pygame.MOUSEMOTION, pixel_of(to)))
    return one.poll()


@given(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.sampled_from([-0.1, 0.0, 0.15]))
def test_the_hanger_follows_the_hand_in_its_plane(dx, dz, at_y):
    """To a pixel or two, from anywhere on the bar."""
    start = np.array([0.1, at_y, 0.4])
    reading = guided(HANGER, start, start + np.array([dx, 0.0, dz]))
    assert reading.hand == pytest.approx(np.array([0.1 + dx, 0.0, 0.4 + dz]), abs=0.012)
    assert reading.moving


@given(st.integers(0, 1), st.integers(-80, 80), st.integers(-80, 80))
def test_a_picker_follows_the_mouse_at_its_distance_and_the_other_one_stays(which, dx, dy):
    start = pixel_of(CORNERS[which])
    one = HandGuidingTeleoperator(PICKERS, ray, lambda: CORNERS)
    one.on_event(mouse(pygame.MOUSEBUTTONDOWN, start))
    one.on_event(mouse(pygame.MOUSEMOTION, (start[0] + dx, start[1] + dy)))
    hand = one.poll().hand
    (seen,), _ = VIEW.project(hand[which], SIZE)
    assert seen == pytest.approx([start[0] + dx, start[1] + dy], abs=1.0)
    level = ray(start)[1] * [1, 1, 0]
    assert (hand[which] - CORNERS[which]) @ level == pytest.approx(0.0, abs=1e-9)
    assert (hand[1 - which] == CORNERS[1 - which]).all()


def test_a_press_holds_without_a_jump_until_it_is_released():
    one = HandGuidingTeleoperator(HANGER, ray, lambda: CORNERS)
    one.on_event(mouse(pygame.MOUSEBUTTONDOWN, pixel_of([0.1, 0.1, 0.4])))
    assert one.poll().hand == pytest.approx(np.array([0.1, 0.0, 0.4]))
    one.on_event(mouse(pygame.MOUSEBUTTONUP, (0, 0)))
    assert one.poll().hand is None


def test_nothing_is_grabbed_beside_the_robot_or_before_it_is_there():
    origin, direction = ray(pixel_of([0.1, 0.0, 0.4 + 3 * GRAB_M]))
    for robot in ROBOT_SPECS:
        assert grab(robot, CORNERS, origin, direction) is None
        assert grab(robot, np.full((2, 3), np.inf), origin, direction) is None


def test_the_hanger_can_be_guided_when_seen_edge_on():
    origin, direction = np.array([3.0, 0.0, 0.4]), np.array([-1.0, 0.0, 0.0])
    hold = grab(HANGER, CORNERS, origin, direction)
    assert hold is not None
    hold.guide(origin, np.array([-1.0, 0.05, 0.1]))
    assert hold.hand[2] > 0.5
    assert hold.hand[1] == 0.0


def test_a_device_beside_a_keyboard_gives_the_commands_of_both():
    pad, board = FakeTeleoperator(), FakeTeleoperator()
    pad.motion = np.array([1.0, 0.0])
    board.motion = np.array([0.0, 1.0])
    both = CombinedInput(pad, board)
    pad.commands, board.commands = [Command.START], [Command.QUIT]
    reading = both.poll()
    assert reading.commands == (Command.START, Command.QUIT)
    assert reading.motion.tolist() == [1.0, 0.0]
    pad.connected = False
    board.commands = [Command.QUIT]
    gone = both.poll()
    assert (gone.connected, gone.commands) == (False, (Command.QUIT,))
    assert isinstance(both, Teleoperator)


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
def test_an_impossible_input_is_refused(wrong):
    with pytest.raises(DataError):
        TeleopInput(**({"motion": np.zeros(2)} | wrong))
