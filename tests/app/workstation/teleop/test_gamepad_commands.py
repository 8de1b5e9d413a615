"""`layflat gamepad monitor|calibrate` with virtual gamepads, and a whole recording with one."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from rich.console import Console

from layflat.app.cli import main
from layflat.app.commands import doctor
from layflat.app.commands import gamepad as commands
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.calibration import Calibration, RawState
from layflat.app.workstation.teleop.devices import GamepadRegistry
from layflat.app.workstation.teleop.gamepad import FINE_SPEED, Gamepad
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, STICKS, TRIGGERS, GamepadState
from layflat.app.workstation.teleop.mapping import DeviceCapabilities, PadMapping, mapping_file, read_mapping
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.terminal.display import TerminalDisplay, run_recording
from layflat.data.session.reader import open_session
from layflat.tests.app.workstation.fakes import FakeClient
from layflat.tests.app.workstation.teleop.test_gamepad import B_AXES, B_BUTTONS
from layflat.tests.factories import HANGER
from layflat.tests.virtual_pad import VirtualPad

OPTIONAL = ("ps", "l3", "r3", "up", "down", "left", "right")


def _call(capsys, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main.main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return int(stop.value.code or 0), out, err


class Person:
    """Does what a calibration asks for, on a gamepad with a layout of its own, on a clock of their own."""

    def __init__(self, pad: VirtualPad, places: dict[str, Callable[[bool], None]]) -> None:
        self.now = 0.0
        self.asked: list[str] = []
        self._pad = pad
        self._places = places
        self._left = [*TRIGGERS, *STICKS, *BUTTONS]
        self._due: list[tuple[float, Callable[[], None]]] = []

    def ask(self, text: str) -> None:
        self.asked.append(text)
        if text.startswith(("pull", "push", "press")):
            self._act(self._left.pop(0))

    def _act(self, name: str) -> None:
        place = self._places.get(name)
        if place is not None:
            self._due += [(self.now + 0.5, lambda: place(True)), (self.now + 1.5, lambda: place(False))]

    def passes(self, seconds: float) -> None:
        self.now += seconds
        for due in [due for due in self._due if due[0] <= self.now]:
            self._due.remove(due)
            due[1]()

    def calibrate(self, joystick, counts: DeviceCapabilities) -> PadMapping:
        import pygame

        calibration = Calibration(counts, self.ask, lambda: self.now)
        while not calibration.done:
            pygame.event.pump()
            calibration.update(RawState.of(joystick))
            self.passes(0.02)
            assert self.now < 300
        return calibration.mapping()


def _places(pad: VirtualPad, axes: dict[str, int], buttons: dict[str, int], flip: tuple[str, ...] = ()):
    """How each input of a pad is moved."""

    def stick(name: str):
        return lambda on: pad.axis(axes[name], (-1.0 if name in flip else 1.0) if on else 0.0)

    def trigger(name: str):
        return lambda on: pad.axis(axes[name], 1.0 if on else -1.0)

    def button(number: int):
        return lambda on: pad.button(number, on)

    places = {name: stick(name) for name in STICKS} | {name: trigger(name) for name in TRIGGERS if name in axes}
    return places | {name: button(number) for name, number in buttons.items()}


def _asks(monkeypatch, person: Person) -> None:
    """Let the person answer the command's questions, on a clock of their own."""

    class Clock:
        monotonic = staticmethod(lambda: person.now)
        sleep = staticmethod(person.passes)

    class Asked(Calibration):
        def __init__(self, capabilities, prompt, clock, **options) -> None:
            super().__init__(capabilities, lambda text: (prompt(text), person.ask(text)), clock, **options)

    monkeypatch.setattr(commands, "time", Clock)
    monkeypatch.setattr(commands, "Calibration", Asked)


def test_a_calibration_finds_an_unknown_layout(plug, tmp_path):
    """Axes in another order, one reversed, triggers at 0 before their first move and buttons beside them, a hat."""
    import pygame

    axes = {"right_y": 0, "l2": 1, "left_y": 2, "r2": 3, "left_x": 4, "right_x": 5}
    numbers = [14, 12, 10, 8, 6, 4, 2, 0, 1, 3, 5]
    buttons = dict(zip(BUTTONS[:11], numbers, strict=True))
    pad = plug(6, 16, 1, known=False, name="Strange")
    places = _places(pad, axes, buttons, flip=("left_y",))
    places["up"] = lambda on: pad.hat(0, 0, int(on))
    places["down"] = lambda on: pad.hat(0, 0, -int(on))
    places["left"] = lambda on: pad.hat(0, -int(on), 0)
    places["right"] = lambda on: pad.hat(0, int(on), 0)
    plain = places["l2"]
    places["l2"] = lambda on: (plain(on), pad.button(15, on))
    joystick = pygame.joystick.Joystick(0)
    layout = Person(pad, places).calibrate(joystick, DeviceCapabilities(6, 16, 1))
    expected = {name: f"a{axes[name]}" + ("~" if name == "left_y" else "") for name in (*STICKS, *TRIGGERS)}
    expected |= {name: f"b{number}" for name, number in buttons.items()}
    assert layout == expected | {"up": "h0.1", "down": "h0.4", "left": "h0.8", "right": "h0.2"}


def test_missing_buttons_are_left_out(plug):
    import pygame

    pad = plug(4, 10, 0, known=False, name="Plain")
    axes = {name: index for index, name in enumerate(STICKS)}
    buttons = {
        name: k for k, name in enumerate(("cross", "circle", "square", "triangle", "share", "options", "l1", "r1"))
    }
    person = Person(pad, _places(pad, axes, buttons))
    layout = person.calibrate(pygame.joystick.Joystick(0), DeviceCapabilities(4, 10, 0))
    assert set(layout) == {*STICKS, *buttons}
    assert sum("left out" in text for text in person.asked) == len(OPTIONAL) + len(TRIGGERS)


def test_a_d_pad_of_half_axes_is_found(plug):
    """The first press for down goes up again, which is known already."""
    import pygame

    pad = plug(6, 9, 0, known=False, name="Half axes")
    axes = {name: index for index, name in enumerate(STICKS)}
    names = ("cross", "circle", "square", "triangle", "share", "options", "l1", "r1")
    places = _places(pad, axes, {name: k for k, name in enumerate(names)})
    for name, axis, sign in (("up", 5, -1), ("down", 5, 1), ("left", 4, -1), ("right", 4, 1)):
        places[name] = lambda on, axis=axis, sign=sign: pad.axis(axis, sign * float(on))
    person = Person(pad, places)
    ask = person.ask

    def confused(text: str) -> None:
        ask(text)
        if "d-pad down" in text:
            person._due.insert(0, (person.now + 0.1, lambda: pad.axis(5, -1.0)))
            person._due.insert(1, (person.now + 0.3, lambda: pad.axis(5, 0.0)))

    person.ask = confused
    layout = person.calibrate(pygame.joystick.Joystick(0), DeviceCapabilities(6, 9, 0))
    assert {name: layout[name] for name in BUTTONS[-4:]} == {"up": "-a5", "down": "+a5", "left": "-a4", "right": "+a4"}


def test_a_calibration_without_input_ends(plug):
    import pygame

    pad = plug(6, 13, 1, known=False)
    with pytest.raises(LayflatError, match="nothing was pressed for left x"):
        Person(pad, {}).calibrate(pygame.joystick.Joystick(0), DeviceCapabilities(6, 13, 1))
    with pytest.raises(LayflatError, match="two sticks need four"):
        Calibration(DeviceCapabilities(2, 10, 0), print, lambda: 0.0)


def test_calibrate_writes_a_mapping_that_recording_uses(plug, capsys, monkeypatch):
    """The whole command, on a gamepad of layout B with another name."""
    pad = plug(6, 13, 2, known=False, name="Renamed")
    places = _places(pad, B_AXES, B_BUTTONS)
    person = Person(pad, places)
    assert not Gamepad(HANGER).poll().connected

    _asks(monkeypatch, person)
    status, out, err = _call(capsys, "gamepad", "calibrate")
    assert status == 0
    assert "push the left stick to the right" in err
    (path,) = mapping_file("x").parent.iterdir()
    assert out == f"calibrated Renamed: {path}\n"
    assert read_mapping(path, DeviceCapabilities(6, 13, 2))[0]["right_y"] == "a4"
    gamepad = Gamepad(HANGER)
    assert gamepad.poll().connected
    pad.axis(B_AXES["l2"], 1.0)
    pad.button(B_BUTTONS["triangle"], True)
    reading = gamepad.poll()
    assert reading.speed == pytest.approx(FINE_SPEED, abs=0.001)
    assert reading.commands == (Command.KEEP_SUCCESS,)
    gamepad.close()
    status, _, err = _call(capsys, "gamepad", "calibrate")
    assert status == 2
    assert "--force" in err


def _state_of_first():
    """Return the state of the first gamepad as recording reads it."""
    pygame, controller = sdl.start()
    pads = GamepadRegistry(pygame, controller)
    pads.refresh()
    pygame.event.pump()
    (device,) = pads.devices.values()
    state = device.state()
    pads.close()
    return state, device.source


def test_worn_sticks_are_learned_and_their_mapping_stays(plug, capsys, monkeypatch):
    """A stick that rests at 0.35 and another time at 0.25 no longer moves anything, and still reaches both ends."""
    pad = plug(name="Worn")
    rests = iter([0.35, 0.25, 0.3, 0.25])

    def stick(name: str):
        def move(on: bool) -> None:
            pad.axis(name, 1.0 if on else -0.1 if name == "left_y" else 0.0)
            if not on:
                pad.axis("left_x", next(rests))

        return move

    pad.axis("left_x", 0.35)
    pad.axis("left_y", -0.1)
    person = Person(pad, {name: stick(name) for name in STICKS})
    person._left = list(STICKS)
    with monkeypatch.context() as patch:
        _asks(patch, person)
        status, out, err = _call(capsys, "gamepad", "calibrate", "--sticks")
    assert status == 0, err
    assert len(person.asked) == 1 + len(STICKS)
    for rest in (0.25, 0.3, 0.35):
        pad.axis("left_x", rest)
        state, source = _state_of_first()
        assert (state.left, source) == ((0.0, 0.0), "SDL")
    for end in (-1.0, 1.0):
        pad.axis("left_x", end)
        assert _state_of_first()[0].left[0] == pytest.approx(end, abs=0.02)
    (path,) = mapping_file("x").parent.iterdir()
    assert out == f"calibrated Worn: {path}\n"
    assert json.loads(path.read_text())["middle"]["left_x"] == pytest.approx(0.3, abs=0.06)


def test_a_dead_zone_is_set_without_a_calibration(plug, capsys):
    pad = plug(name="Loose")
    pad.axis("right_x", 0.25)
    assert _state_of_first()[0].right[0] > 0.1
    assert _call(capsys, "gamepad", "calibrate", "--dead-zone", 0.3)[0] == 0
    assert _state_of_first() == (GamepadState(), "SDL")
    assert _call(capsys, "gamepad", "calibrate", "--dead-zone", 0.05)[0] == 0
    assert _state_of_first()[0].right[0] > 0.2
    assert _call(capsys, "gamepad", "calibrate", "--dead-zone", 1.0)[0] == 2


@pytest.mark.parametrize(
    "change", [{"dead_zone": 2.0}, {"dead_zone": None}, {"middle": {"left_x": 0.9}}, {"middle": 3}]
)
def test_invalid_rests_are_refused(tmp_path, change):
    path = tmp_path / "m.json"
    path.write_text(json.dumps({"schema": 2, "axes": 6, "buttons": 16, "hats": 0, "dead_zone": 0.1} | change))
    with pytest.raises(UsageError):
        read_mapping(path, DeviceCapabilities(6, 16, 0))


NINTENDO = """
import ctypes
from layflat.tests.virtual_pad import library
sdl = library()
class GUID(ctypes.Structure):
    _fields_ = [("data", ctypes.c_uint8 * 16)]
sdl.SDL_JoystickGetGUIDFromString.restype = GUID
sdl.SDL_GameControllerMappingForGUID.argtypes = [GUID]
sdl.SDL_GameControllerMappingForGUID.restype = ctypes.c_char_p
guid = sdl.SDL_JoystickGetGUIDFromString(b"030000007e0500000920000011810000")
print(sdl.SDL_GameControllerMappingForGUID(guid).decode())
"""


@pytest.mark.parametrize("labels", [None, "1"])
def test_a_nintendo_pad_s_buttons_go_by_their_place(labels):
    """In SDL's own database, as the program starts it; its numbers are the kernel's: b0 is the lower one."""
    environment = {**os.environ, **({"SDL_GAMECONTROLLER_USE_BUTTON_LABELS": labels} if labels else {})}
    done = subprocess.run([sys.executable, "-c", NINTENDO], env=environment, capture_output=True, text=True, check=True)
    places = dict(part.split(":") for part in done.stdout.strip().split(",") if part.count(":") == 1)
    assert [places[button] for button in "abxy"] == ["b0", "b1", "b3", "b2"]


def test_a_mapping_for_another_pad_is_refused(plug, tmp_path):
    path = tmp_path / "m.json"
    text = {"schema": 2, "axes": 4, "buttons": 8, "hats": 0, "inputs": {}}
    path.write_text(json.dumps(text))
    with pytest.raises(UsageError, match="4 axes, 8 buttons and 0 hats, and this one has 6 axes"):
        read_mapping(path, DeviceCapabilities(6, 16, 0))
    plug()
    gamepad = Gamepad(HANGER, mapping=path)
    assert str(path) in gamepad.poll().problem
    gamepad.close()


@pytest.mark.parametrize(
    "change",
    [
        {"left_x": "a9"},
        {"left_x": "a1"},
        {"left_x": "a1~"},
        {"left_x": True},
        {"left_x": "a0~~"},
        {"left_x": "b12"},
        {"l2": "a-1"},
        {"l2": float("nan")},
        {"l9": "b13"},
        {"up": "h0.1"},
        {"up": "h0.3"},
        {"cross": "b99"},
        {"cross": "b1"},
        {"cross": "import os"},
        {"cross": "b12,a:b13"},
        {"cross": 3},
        {"cross": None},
    ],
    ids=str,
)
def test_an_invalid_mapping_is_refused(tmp_path, change):
    path = tmp_path / "m.json"
    names = ("cross", "circle", "square", "triangle", "share", "options", "l1", "r1")
    text = {
        "schema": 2,
        "axes": 6,
        "buttons": 16,
        "hats": 0,
        "inputs": {name: f"a{axis}" for axis, name in enumerate((*STICKS, "l2"))}
        | {name: f"b{k}" for k, name in enumerate(names)},
    }
    path.write_text(json.dumps(text))
    read_mapping(path, DeviceCapabilities(6, 16, 0))
    text["inputs"] |= change
    path.write_text(json.dumps(text))
    with pytest.raises(UsageError):
        read_mapping(path, DeviceCapabilities(6, 16, 0))


@pytest.mark.parametrize("command", ["monitor", "calibrate"])
def test_without_a_pad_it_is_one_sentence(command, capsys):
    status, out, err = _call(capsys, "gamepad", command)
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
    assert "no gamepad is plugged in" in err


def test_monitor_prints_a_line_for_each_change(plug, capsys):
    pad = plug(name="Shown")
    pad.axis("left_x", 1.0)
    pad.button("circle", True)
    status, out, err = _call(capsys, "gamepad", "monitor", "--seconds", "0.3")
    assert (status, err) == (0, "")
    first, *changes = out.splitlines()
    assert first == "Shown: known by SDL"
    assert len(changes) == 1
    assert "left x +1.00" in changes[0]
    assert changes[0].endswith("pressed circle")


def test_monitor_shows_the_raw_inputs_of_an_unknown_pad(plug, capsys):
    pad = plug(4, 12, 1, known=False)
    pad.axis(2, -1.0)
    pad.hat(0, 0, 1)
    status, out, err = _call(capsys, "gamepad", "monitor", "--seconds", "0.3")
    assert status == 0
    assert "-1.00" in out
    assert "h0.1" in out
    assert "layflat gamepad calibrate" in err


def test_doctor_lists_usable_gamepads_and_others(plug):
    assert [(check.state, check.found) for check in doctor.gamepads()] == [("note", "none")]
    plug(name="Known")
    plug(4, 12, 1, known=False, name="Strange")
    known, strange = doctor.gamepads()
    assert (known.state, known.found) == ("ok", "Known (known by SDL)")
    assert strange.state == "note"
    assert "Strange" in strange.advice
    assert "layflat gamepad calibrate" in strange.advice


def test_the_table_has_every_command(plug):
    import pygame

    pad = plug()
    pad.button("triangle", True)
    pygame.event.pump()
    pads = GamepadRegistry(*sdl.start())
    pads.refresh()
    console = Console(file=io.StringIO(), width=100)
    console.print(commands._table(pygame.joystick.Joystick(0), next(iter(pads.devices.values()))))
    shown = console.file.getvalue()
    assert all(command.value in shown for command in Command)
    assert next(line for line in shown.splitlines() if "Triangle" in line).count("■") == 1
    pads.close()


def test_a_whole_recording_with_a_gamepad(plug, record, tmp_path):
    """Keep one, disconnect in the middle of the second, continue, discard it, keep a third as failure, quit."""
    one, gamepad, pads = record(), Gamepad(HANGER), [plug()]
    messages: list[str] = []
    rumbles: list[int] = []

    def n_steps() -> int:
        return one.status.steps

    def script() -> Iterator[None]:
        for verdict in ("triangle", "circle", "square"):
            pads[-1].axis("left_x", 0.0)
            pads[-1].axis("left_y", 0.0)
            pads[-1].tap("cross")
            while one.state not in ("still", "running"):
                yield
            pads[-1].axis("left_x", 1.0)
            pads[-1].axis("left_y", 1.0)
            while n_steps() < 5:
                yield
            if verdict == "circle":
                rumbles.append(sum(motors != (0, 0) for motors in pads[-1].rumbles))
                pads.pop().unplug()
                while one.state != "paused":
                    yield
                at = n_steps()
                for _ in range(50):
                    yield
                messages.append(one.status.message.text)
                assert n_steps() == at
                pads.append(plug())
                while one.state == "paused":
                    yield
                pads[-1].axis("left_x", -1.0)
                while n_steps() < at + 5:
                    yield
            pads[-1].tap(verdict)
            while one.state in ("still", "running", "asking"):
                if one.state == "asking":  # The cloth lies otherwise than the label says: the same button is yes.
                    pads[-1].tap(verdict)
                yield
        pads[-1].tap("ps")
        while True:
            yield

    acts = script()

    def pass_time(seconds: float = 0.02) -> None:
        one.now += seconds

    def sleep(seconds: float) -> None:
        pass_time(seconds)
        next(acts)

    run_recording(FakeClient(one), gamepad, TerminalDisplay(io.StringIO()), stopped=lambda: one.now > 1000, sleep=sleep)
    assert one.state == "over"
    assert "Virtual PS4 pad was disconnected; plug it in again" in messages[0]
    # Contact began in each of two demonstrations; SDL makes one of two rumbles that overlap, and time is short here.
    assert rumbles[0] in (1, 2)
    one.close()
    gamepad.close()
    with open_session(tmp_path / "s.h5") as session:
        assert [(info.seed, info.outcome) for info in session.infos().values()] == [(0, "success"), (2, "failure")]
    motions = [episode.inputs[0].motion for episode in one.episodes[:3]]
    assert all(motion == pytest.approx([np.sqrt(0.5), -np.sqrt(0.5)], abs=0.01) for motion in motions)
    assert one.episodes[1].inputs[-1].motion[0] < 0
    assert len(one.lines) == 3
