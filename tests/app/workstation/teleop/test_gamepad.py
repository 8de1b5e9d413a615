"""Gamepads as SDL delivers them: virtual ones, plugged in and out, in every layout."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.app.workstation.teleop.gamepad import COMMANDS, FINE_SPEED, SPEED, Gamepad, motion, speed
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, DEAD_ZONE, GamepadState, dead_zone
from layflat.app.workstation.teleop.mapping import (
    RAW_LAYOUTS,
    DeviceCapabilities,
    check_mapping,
    mapping_file,
    raw_layout,
    write_mapping,
)
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleoperator import Teleoperator
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS

B_AXES = {"left_x": 0, "left_y": 1, "l2": 2, "right_x": 3, "right_y": 4, "r2": 5}
C_AXES = {"left_x": 0, "left_y": 1, "right_x": 2, "l2": 3, "r2": 4, "right_y": 5}
A_AXES = {"left_x": 0, "left_y": 1, "right_x": 2, "right_y": 3, "l2": 4, "r2": 5}
A_BUTTONS = {"cross": 0, "circle": 1, "square": 2, "triangle": 3, "share": 4, "ps": 5, "options": 6, "l1": 9, "r1": 10}
B_BUTTONS = {"cross": 0, "circle": 1, "triangle": 2, "square": 3, "share": 8, "ps": 10, "options": 9, "l1": 4, "r1": 5}
C_BUTTONS = {"cross": 1, "circle": 2, "triangle": 3, "square": 0, "share": 8, "ps": 12, "options": 9, "l1": 4, "r1": 5}
"""From the description of the layouts, not from the code."""
WAYS = {
    "SDL": ((6, 16, 0), True, A_AXES, A_BUTTONS),
    "A": ((6, 16, 0), False, A_AXES, A_BUTTONS),
    "B": ((6, 13, 1), False, B_AXES, B_BUTTONS),
    "C": ((6, 14, 1), False, C_AXES, C_BUTTONS),
    "C without a hat": ((6, 13, 0), False, C_AXES, C_BUTTONS),
}
"""Counts, whether SDL maps it, axes, buttons."""


@pytest.fixture
def source(plug) -> Iterator[Callable[..., Gamepad]]:
    """``source(robot, ...)``: a Gamepad. It is closed before the gamepads are unplugged."""
    made: list[Gamepad] = []

    def make(robot=HANGER, **options) -> Gamepad:
        made.append(Gamepad(robot, **options))
        return made[-1]

    yield make
    for gamepad in made:
        gamepad.close()


@pytest.fixture(params=WAYS)
def any_pad(request, plug, source):
    counts, known, axes, buttons = WAYS[request.param]
    pad = plug(*counts, known=known)
    return source(PICKERS), pad, axes, buttons


def test_each_way_of_knowing_a_pad_reads_its_sticks(any_pad):
    gamepad, pad, axes, _ = any_pad
    assert gamepad.poll().connected
    expected = {"left_x": (3, 1), "left_y": (5, -1), "right_x": (0, 1), "right_y": (2, -1)}
    for name, (place, sign) in expected.items():
        pad.axis(axes[name], 1.0)
        moved = gamepad.poll().motion
        pad.axis(axes[name], 0.0)
        assert moved[place] == pytest.approx(sign, abs=0.001)
        assert np.count_nonzero(moved) == 1
    assert not gamepad.poll().motion.any()


def test_each_way_of_knowing_a_pad_reads_its_triggers(any_pad):
    gamepad, pad, axes, _ = any_pad
    assert gamepad.poll().speed == SPEED  # Unknown pads read 0 there, which would be half pulled.
    pad.axis(axes["r2"], 1.0)
    assert gamepad.poll().speed == pytest.approx(1.0, abs=0.001)
    pad.axis(axes["r2"], 0.0)
    half = gamepad.poll().speed
    assert SPEED < half < 1.0  # Now 0 is true.
    pad.axis(axes["r2"], -1.0)
    pad.axis(axes["l2"], 1.0)
    assert gamepad.poll().speed == pytest.approx(FINE_SPEED, abs=0.001)
    pad.axis(axes["l2"], -1.0)
    assert gamepad.poll().speed == pytest.approx(SPEED, abs=0.001)


def test_triggers_of_a_mapped_pad_at_0_before_their_first_move_count_as_released(plug, source):
    pad, gamepad = plug(), source()
    for name in ("l2", "r2"):
        pad.axis(name, 0.0)
    assert [gamepad.poll().speed for _ in range(4)] == [SPEED] * 4
    pad.axis("r2", 0.5)
    assert gamepad.poll().speed == pytest.approx(SPEED + 0.75 * (1 - SPEED), abs=0.001)
    pad.axis("r2", 0.0)
    assert gamepad.poll().speed == pytest.approx(SPEED + 0.5 * (1 - SPEED), abs=0.001)


def test_each_way_of_knowing_a_pad_reports_its_buttons_once(any_pad):
    gamepad, pad, _, buttons = any_pad
    gamepad.poll()
    for name in ("cross", "circle", "square", "triangle", "share", "options", "ps"):
        pad.button(buttons[name], True)
        assert gamepad.poll().commands == (COMMANDS[name],)
        assert gamepad.poll().commands == ()
        pad.button(buttons[name], False)
        assert gamepad.poll().commands == ()


def test_taps_between_two_polls_are_reported_in_their_order(any_pad):
    gamepad, pad, _, buttons = any_pad
    gamepad.poll()
    for name in ("triangle", "cross", "options"):
        pad.tap(buttons[name])
    assert gamepad.poll().commands == (Command.KEEP_SUCCESS, Command.START, Command.PAUSE)
    assert gamepad.poll().commands == ()


def test_the_d_pad_of_a_hat_is_a_button(plug, source):
    pad, gamepad = plug(6, 13, 1, known=False), source()
    gamepad.poll()
    pad.hat(0, 0, 1)
    assert gamepad.poll().commands == (Command.DISTURB,)
    pad.hat(0, 0, 0)
    assert gamepad.poll().commands == ()


def still(axes: int, buttons: int, hats: int, at: dict[int, float] | None = None) -> SimpleNamespace:
    """Return a raw gamepad at rest, with some axes elsewhere."""
    return SimpleNamespace(
        get_numaxes=lambda: axes, get_numbuttons=lambda: buttons, get_numhats=lambda: hats,
        get_axis=lambda k: (at or {}).get(k, 0.0), get_button=lambda k: False, get_hat=lambda k: (0, 0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("pad", "layout"),
    [
        (still(6, 16, 0), "A"),
        (still(6, 13, 1), "B"),
        (still(6, 13, 1, {2: -1.0, 5: -1.0}), "B"),
        (still(6, 13, 1, {3: -1.0, 4: -1.0}), "C"),
        (still(6, 14, 1), "C"),
        (still(6, 13, 0), "C without a hat"),
        (still(4, 12, 1), None),
        (still(6, 11, 1), None),
        (still(8, 16, 0), None),
    ],
)
def test_a_raw_layout_is_found_by_its_counts(pad, layout):
    assert raw_layout(pad) == layout
    if layout is not None:
        check_mapping(RAW_LAYOUTS[layout], DeviceCapabilities.of(pad))


def test_a_wrong_guess_of_sdl_is_not_used(plug, source):
    first = plug(6, 16, 0, known=True, name="Guessed")
    source().poll()
    first.unplug()  # SDL says of the next one, too, that its d-pad is button 11 to 14.
    pad, gamepad = plug(6, 13, 1, known=True, name="Guessed"), source()
    gamepad.poll()
    pad.button(B_BUTTONS["options"], True)
    assert gamepad.poll().commands == (Command.PAUSE,)


def test_an_unknown_pad_can_be_calibrated(plug, source):
    plug(4, 12, 1, known=False, name="Old joystick")
    reading = source().poll()
    assert not reading.connected
    assert "Old joystick" in reading.problem
    assert "layflat gamepad calibrate" in reading.problem


def test_another_makers_pad_that_sdl_knows_works(plug, source):
    pad, gamepad = plug(6, 15, 0, known=True, name="Another maker's"), source()
    assert gamepad.poll().device == "Another maker's"
    pad.axis("left_x", -1.0)
    assert gamepad.poll().motion[0] == pytest.approx(-1.0)


def test_a_calibrated_pad_is_read_as_calibrated(plug, source):
    pad = plug(5, 9, 0, known=False, name="Calibrated joystick")
    import pygame

    joystick = pygame.joystick.Joystick(0)
    buttons = [b for b in BUTTONS if b in ("cross", "circle", "square", "triangle", "share", "options", "l1", "r1")]
    layout = {"left_x": "a3~", "left_y": "a2", "right_x": "a1", "right_y": "a0", "r2": "+a4", "l2": "b8"}
    layout |= {name: f"b{7 - index}" for index, name in enumerate(buttons)}
    guid = joystick.get_guid()
    write_mapping(
        mapping_file(guid), layout, guid=guid, name="Calibrated joystick", capabilities=DeviceCapabilities(5, 9, 0)
    )
    gamepad = source()
    gamepad.poll()
    pad.axis(3, 1.0)
    pad.button(7, True)
    reading = gamepad.poll()
    assert reading.motion == pytest.approx([-1.0, 0.0], abs=0.001)
    assert reading.commands == (Command.START,)
    pad.button(8, True)
    assert gamepad.poll().speed == pytest.approx(FINE_SPEED)


def test_a_damaged_mapping_is_a_problem_that_names_it(plug, source):
    plug(4, 12, 1, known=False)
    import pygame

    path = mapping_file(pygame.joystick.Joystick(0).get_guid())
    path.parent.mkdir(parents=True)
    for text in ("{", "[]", '{"schema": 1}', '{"schema": 1, "axes": 6, "buttons": 12, "hats": 1}', "\x00" * 10):
        path.write_text(text)
        gamepad = source()
        reading = gamepad.poll()
        gamepad.close()
        assert not reading.connected
        assert str(path) in reading.problem


def test_without_a_pad_the_problem_says_what_works_instead(source):
    reading = source().poll()
    assert not reading.connected
    assert not reading.moving
    assert "use the keyboard" in reading.problem


def test_unplugged_and_plugged_in_again(plug, source):
    pad, gamepad = plug(), source()
    pad.axis("left_x", 1.0)
    assert gamepad.poll().moving
    pad.unplug()
    gone = gamepad.poll()
    assert (gone.connected, gone.moving, gone.commands) == (False, False, ())
    assert "Virtual PS4 pad was disconnected" in gone.problem
    assert not gamepad.poll().connected
    again = plug()
    assert gamepad.poll().connected
    again.axis("left_y", -1.0)
    again.button("cross", True)
    back = gamepad.poll()
    assert back.motion == pytest.approx([0.0, 1.0], abs=0.001)
    assert back.commands == (Command.START,)


def test_a_pad_may_come_later_and_a_button_that_is_held_then_is_not_a_press(plug, source):
    gamepad = source()
    assert not gamepad.poll().connected
    pad = plug()
    assert gamepad.poll().connected
    pad.button("circle", True)
    gamepad.poll()
    gamepad.close()
    assert source().poll().commands == ()


def test_of_two_pads_the_first_is_used(plug, source):
    first, second, gamepad = plug(name="First"), plug(name="Second"), source()
    assert gamepad.poll().device == "First (1 more not used)"
    second.axis("left_x", 1.0)
    second.button("cross", True)
    reading = gamepad.poll()
    assert (reading.moving, reading.commands) == (False, ())
    second.axis("left_x", 0.0)
    second.button("cross", False)
    gamepad.poll()
    first.unplug()
    lone = gamepad.poll()
    assert not lone.connected  # The second one may lie somewhere.
    assert "Second" in lone.problem
    second.tap("options")
    taken = gamepad.poll()
    assert (taken.connected, taken.device) == (True, "Second")


def test_rumble_reaches_the_pad(plug, source):
    for known in (True, False):
        pad, gamepad = plug(known=known), source()
        gamepad.poll()
        gamepad.rumble(0.5, 0.2)
        assert pad.rumbles
        assert pad.rumbles[-1][0] == pytest.approx(0.5 * 65535, abs=2)
        gamepad.close()
        pad.unplug()
    source().rumble(1.0, 0.1)  # Nothing to shake, nothing to complain about.


def test_a_window_passes_events_on_and_keeps_the_others(plug, source):
    import pygame

    pad, gamepad = plug(), source(own_events=False)
    gamepad.poll()
    pygame.event.get()
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_a))
    pad.tap("triangle")
    others = [event for event in pygame.event.get() if not gamepad.on_event(event)]
    assert [event.type for event in others if event.type == pygame.KEYDOWN] == [pygame.KEYDOWN]
    assert gamepad.poll().commands == (Command.KEEP_SUCCESS,)
    assert gamepad.poll().commands == ()


@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
def test_it_is_a_teleoperator(source, robot):
    gamepad = source(robot)
    assert isinstance(gamepad, Teleoperator)
    assert gamepad.poll().motion.shape == (robot.size,)
    assert {button.command for button in gamepad.help()} >= set(Command)


@pytest.mark.parametrize(
    ("held", "right", "left"),
    [
        ((), [-0.7, 0.0, 0.1], [0.3, 0.0, 0.5]),
        (("l1",), [0.0, -0.7, 0.1], [0.0, 0.3, 0.5]),  # To the right is +y.
        (("r1",), [0.3, -0.7, 0.5], [0.3, -0.7, 0.5]),
    ],
)
def test_sticks_of_two_points(held, right, left):
    """The left one, at -y, is point 1."""
    state = GamepadState(left=(0.3, 0.5), right=(-0.7, 0.1), pressed=frozenset(held))
    assert motion(PICKERS, state).reshape(2, 3).tolist() == [right, left]


AXIS = st.floats(-1.0, 1.0)


@given(AXIS, AXIS)
def test_dead_zone_keeps_the_direction_and_the_bounds(x, y):
    out_x, out_y = dead_zone(x, y)
    assert math.hypot(out_x, out_y) <= 1.0 + 1e-12
    if math.hypot(x, y) <= DEAD_ZONE:
        assert (out_x, out_y) == (0.0, 0.0)
    else:
        assert out_x * y == pytest.approx(out_y * x, abs=1e-12)
        assert out_x * x + out_y * y > 0
    assert dead_zone(-x, -y) == (-out_x, -out_y)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-math.pi, math.pi))
def test_dead_zone_rises_without_a_step(a, b, angle):
    def length(r: float) -> float:
        return math.hypot(*dead_zone(r * math.cos(angle), r * math.sin(angle)))

    assert (length(a) <= length(b) + 1e-12) if a <= b else (length(b) <= length(a) + 1e-12)
    # Slope of what is left of the way: no two near places are far apart afterwards.
    assert abs(length(a) - length(b)) <= abs(a - b) / (1 - DEAD_ZONE) + 1e-9
    assert length(1.0) == pytest.approx(1.0)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_speed_stays_within_its_bounds(l2, r2):
    assert FINE_SPEED <= speed(GamepadState(l2=l2, r2=r2)) <= 1.0
    assert speed(GamepadState(r2=r2)) >= SPEED >= speed(GamepadState(l2=l2))
