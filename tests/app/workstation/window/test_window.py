"""A person uses the whole window: a virtual gamepad, keys, the mouse, and what is on disk."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pygame
import pytest

from layflat.app.media.cloth_colors import contrast
from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.effects import describe, effects
from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.session.verdict import judge
from layflat.app.workstation.window import panels, sound, style
from layflat.app.workstation.window.display import load_memory
from layflat.app.workstation.window.orbit_camera import PRESETS
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.tools.validate import validate
from layflat.data.types import ACTION_LIMIT_M, Episode
from layflat.policy.spec import PolicySpec
from layflat.sim.robots.registry import robot_spec
from layflat.tests.app.workstation.person import Person, post
from layflat.tests.app.workstation.window.conftest import leftovers
from layflat.tests.factories import PICKERS

pytestmark = pytest.mark.timeout(400)


def stored_episodes(path: Path) -> list[Episode]:
    assert not validate(path)
    with open_session(path) as session:
        return [session.episode(name) for name in session.names]


def record_three(person: Person, n_steps: int | None) -> list[int]:
    """Keep one, discard one, keep one with a disconnect in its middle; return the numbers of steps of those kept."""
    pad, lengths = person.plug_in(), []

    def keep() -> None:
        before, n_steps = person.status.n_episodes, person.status.steps
        person.pad.tap("triangle")
        person.keep_anyway(lambda: person.status.n_episodes == before + 1)
        kept = re.search(r"kept demo_\d success (\d+) steps", person.events[-1].text)
        assert int(kept[1]) >= n_steps
        lengths.append(int(kept[1]))

    person.begin()
    person.demonstrate(0, n_steps=n_steps)
    keep()
    person.begin()
    person.demonstrate(1, n_steps=8)
    pad.tap("circle")
    person.wait(lambda: person.status.seed == 2, "it to be discarded")
    person.begin()
    person.demonstrate(2, n_steps=8)
    pad.unplug()
    person.wait(lambda: person.state == "paused", "the pause")
    assert "was disconnected" in person.window.inputs.newest.problem
    person.watch(0.8)  # A step that has begun ends.
    at = person.status.steps
    person.watch(0.5)
    assert person.status.steps == at, "time does not pass without a device"
    person.plug_in()
    person.wait(lambda: person.state in ("still", "running"), "it to continue")
    person.demonstrate(2, n_steps=n_steps)
    keep()
    person.pad.tap("ps")
    person.wait(lambda: not person.window.open, "the end of the recording")
    return lengths


def record_and_look(person: Person, robot: str, n_steps: int | None) -> list[Episode]:
    """Record, and compare the file with exactly what was kept."""
    lengths, path = record_three(person, n_steps), person.window.contents.request.session
    person.window.close()
    episodes = stored_episodes(path)
    assert [(e.outcome, e.source, e.robot.name, e.seed) for e in episodes] == [
        ("success", "gamepad", robot, 0),
        ("success", "gamepad", robot, 2),
    ]
    assert [len(episode.steps) for episode in episodes] == lengths
    for episode in episodes:
        actions = np.array([step.action for step in episode.steps])
        assert actions.shape[1] == robot_spec(robot).size
        assert 0 < np.abs(actions).max() <= ACTION_LIMIT_M
        times = [seen.time_s for seen in episode.observations()]
        np.testing.assert_allclose(np.diff(times), episode.step_s, atol=1e-9)
        assert not any(step.drag for step in episode.steps)
    assert not [one for one in path.parent.rglob("*") if one.suffix in (".journal", ".part")]
    return episodes


def test_a_short_recording_by_gamepad(sit_down):
    record_and_look(sit_down("hanger"), "hanger", n_steps=14)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("robot", ["hanger", "pickers"])
def test_a_recording_by_gamepad(sit_down, robot):
    # The person laid it: the demonstrations are what their verdict says.
    assert all(e.final_ground_truth.flat_area > 0.9 for e in record_and_look(sit_down(robot), robot, n_steps=None))


def test_a_simulation_that_dies_costs_one_demonstration(sit_down):
    person = sit_down()
    person.plug_in()
    person.begin()
    person.demonstrate(0, n_steps=10)
    (take,) = psutil.Process(person.window.client.pid).children()
    take.kill()
    person.pad.axis("left_y", 0.5)
    person.wait(lambda: person.status.counts["partial"] == 1, "the loss")
    person.pad.axis("left_y", 0.0)
    # The same start again, and the device still works.
    person.begin()
    person.demonstrate(0, n_steps=6)
    person.pad.tap("square")
    person.keep_anyway(lambda: person.status.n_episodes == 2)
    person.key(pygame.K_ESCAPE)
    assert not person.window.open
    person.window.close()
    partial, whole = stored_episodes(person.window.contents.request.session)
    assert (partial.outcome, partial.stopped_by, whole.outcome) == ("partial", "crashed", "failure")
    assert len(partial.steps) >= 8


def test_a_session_that_dies_ends_the_window_with_a_reason(sit_down):
    person = sit_down()
    person.plug_in()
    person.begin()
    person.demonstrate(0, n_steps=10)
    bench = psutil.Process(person.window.client.pid)
    family = [bench, *bench.children(recursive=True)]
    bench.kill()
    person.wait(lambda: not person.window.open, "the end")
    with pytest.raises(LayflatError, match="SIGKILL"):
        person.window.client.check()
    person.window.close()
    psutil.wait_procs(family, timeout=40)
    assert leftovers() == []
    # The next recording saves its steps.
    again = sit_down()
    again.wait(lambda: again.status.n_episodes == 1, "the recovered steps")
    again.window.close()
    (partial,) = stored_episodes(person.window.contents.request.session)
    assert partial.outcome == "partial"


def test_the_hanger_is_guided_by_hand(sit_down):
    """The mouse grabs the hanger, which is compliant; what it did is the action."""
    person = sit_down("hanger", "kinesthetic")
    window = person.window
    person.wait(lambda: person.state == "waiting" and person.status.ready, "the cloth")
    person.key(pygame.K_RETURN)
    person.wait(lambda: person.state in ("still", "running"), "the countdown")
    before, view = person.seen(), window.painter.layout.view
    x, y = window.inputs.viewport.pixel_of(before.corners[1], view.size)
    person.drag_pixel((x + view.left, y + view.top), (30, 90), frames=30, until=lambda: person.status.steps >= 8)
    after = person.seen()
    person.press("keep as failure")
    person.keep_anyway(lambda: person.status.n_episodes == 1)
    person.press("q")
    window.close()
    (episode,) = stored_episodes(window.contents.request.session)
    assert episode.source == "kinesthetic"
    # Down and forward, as it was guided.
    moved = after.holder - before.holder
    assert moved[0] > 0.005
    assert moved[2] < -0.02
    # After the release, no action has the distance that the arm coasts.
    n = sum(step.hand_m is not None for step in episode.steps)
    assert n >= 8
    assert all(step.hand_m is not None for step in episode.steps[:n])
    made = np.array([step.action for step in episode.steps[:n]]).sum(axis=0)
    went = episode.observations()[n].holder_position - episode.steps[0].observation.holder_position
    np.testing.assert_allclose(made, went[[0, 2]], atol=1e-4)


@pytest.mark.parametrize("source", ["keyboard", "mouse"])
def test_a_tap_within_a_frame_moves_for_a_step(sit_down, source):
    """Keys that are down and up again before the window looks are what VNC and on-screen keyboards send."""
    person = sit_down("hanger", source, speed=1.0)
    person.wait(lambda: person.state == "waiting" and person.status.ready, "the cloth")
    person.key(pygame.K_RETURN)
    person.wait(lambda: person.state in ("still", "running"), "the countdown")
    heights = [person.seen().holder[2]]
    for _ in range(3):
        person.key(pygame.K_DOWN)
        person.wait(lambda: person.seen().holder[2] < heights[-1] - 0.003, "the tap to act", 20)
        person.watch(0.7)
        heights.append(person.seen().holder[2])
    person.watch(1.5)
    heights.append(person.seen().holder[2])
    person.watch(0.5)
    assert person.seen().holder[2] == pytest.approx(heights[-1], abs=0.004), "a tap ends"
    person.key(pygame.K_n)
    person.keep_anyway(lambda: person.status.n_episodes == 1)
    person.window.close()
    (episode,) = stored_episodes(person.window.contents.request.session)
    moved = [bool(np.any(step.action)) for step in episode.steps]
    assert 3 <= sum(moved) <= 9


SIZES = [((800, 600), 1.0), ((1280, 720), 1.0), ((3840, 2160), 2.0), ((640, 400), 1.0), ((320, 240), 1.0)]


@pytest.mark.parametrize("source", ["keyboard", "gamepad"])
@pytest.mark.parametrize(("size", "scale"), SIZES)
def test_everything_is_said_at_every_size(sit_down, size, scale, source):
    """All key chips are whole and inside the window, and no area lies over another, in each state."""
    person = sit_down("pickers", source, size=size, scale=scale)
    person.wait(lambda: person.status.ready, "the cloth")
    person.look()
    assert person.window.painter.surface.get_size() == size
    check_place(person, size)
    judged = judge(0.77, 0.82, False, None)
    for state in ("countdown", "still", "running", "paused", "stopped", "finished", "asking"):
        status = replace(
            person.status, state=state, steps=109, can_drag=True, can_disturb=True, verdict=judged, pace_s=41.0,
            policy="gp-word+recovery", controller="you", disturbances=("push", "fold-corner"), discarded=(3, 84),
            question=f"{judged.words}: keep as success?" if state == "asking" else "", intervention_steps=12,
        )  # fmt: skip
        status = replace(status, effects=effects(status))
        person.window.client.status = replace(status, message=describe(status))
        person.window.painter.draw()
        check_place(person, size)


def check_place(person: Person, size: tuple[int, int]) -> None:
    painter, contents = person.window.painter, person.window.contents
    place = painter.layout
    areas = {name: area for name, area in vars(place).items() if name != "window"}
    for (one, a), (other, b) in itertools.combinations(areas.items(), 2):
        assert not a.colliderect(b), f"{one} and {other}"
        assert place.window.contains(a), one
    wanted = [*contents.key_hints(), *contents.window_hints(), *contents.view_hints()]
    assert sorted(hint[:2] for _, hint in painter.hints) == sorted(hint[:2] for hint in wanted)
    for area, hint in painter.hints:
        assert any(whole.contains(area) for whole in areas.values()), hint[:2]
    for (a, one), (b, other) in itertools.combinations(painter.hints, 2):
        assert not a.colliderect(b), f"{one[:2]} and {other[:2]}"
    assert place.view.width > 0.4 * size[0]
    assert place.view.height > 0.3 * size[1]


def test_letters_are_as_large_on_a_dense_display(sit_down):
    person = sit_down("hanger", "keyboard", size=(3840, 2160), scale=2.0)
    assert person.window.painter.scale == 2.0
    assert person.window.painter._canvas(person.window.painter.layout.facts).pitch(15) >= 30
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    person.look()
    assert not person.window.open


def test_size_letters_and_sound_are_remembered(sit_down):
    person = sit_down("pickers", "keyboard", size=(1000, 700))
    person.key(pygame.K_m)
    person.key(pygame.K_EQUALS, pygame.KMOD_CTRL)
    pygame.display.set_mode((1100, 800), pygame.RESIZABLE)
    post(pygame.VIDEORESIZE, size=(1100, 800), w=1100, h=800)
    person.look()
    person.window.close()
    memory = load_memory()
    assert (memory.width, memory.height, memory.sound) == (1100, 800, False)
    assert memory.zoom == pytest.approx(1.1)
    again = sit_down("pickers", "keyboard")
    assert again.window.painter.surface.get_size() == (1100, 800)
    assert again.window.painter.scale == pytest.approx(1.1)
    assert not again.window.inputs.tone.on


def test_only_changes_are_drawn(sit_down, monkeypatch):
    person = sit_down("pickers", "keyboard")
    person.wait(lambda: person.status.ready, "the cloth")
    person.watch(0.3)
    drawn: list[int] = []
    monkeypatch.setattr(pygame.display, "update", lambda areas: drawn.append(len(areas)))
    for _ in range(10):
        person.look()
    assert sum(drawn) <= 1


def test_keys_and_clicks_choose_the_view(sit_down):
    person = sit_down("hanger", "keyboard")
    for key, name in ((pygame.K_F2, "side"), (pygame.K_F3, "top"), (pygame.K_F4, "front"), (pygame.K_F5, "reset")):
        person.key(key)
        assert person.window.inputs.viewport.camera == PRESETS[name]
    person.press("top")
    assert person.window.inputs.viewport.camera == PRESETS["top"]
    view = person.window.painter.layout.view
    person.drag_pixel(view.center, (40, 0))
    assert person.window.inputs.viewport.camera != PRESETS["top"]


def test_a_drag_of_the_mouse_shows_how_fast_it_is(sit_down):
    person = sit_down("hanger", "mouse")
    view = person.window.painter.layout.view
    before = picture(person, view)
    post(pygame.MOUSEBUTTONDOWN, pos=view.center, button=1)
    post(pygame.MOUSEMOTION, pos=(view.centerx + 75, view.centery), rel=(75, 0), buttons=(1, 0, 0))
    person.look()
    assert person.window.inputs.device.band() == (view.center, (view.centerx + 75, view.centery), 150.0)
    assert person.window.inputs.newest.motion[0] == pytest.approx(0.5, abs=0.05)
    assert np.any(picture(person, view) != before, axis=2).sum() > 500
    post(pygame.MOUSEBUTTONUP, pos=view.center, button=1)
    person.look()
    assert person.window.inputs.device.band() is None


def picture(person: Person, area: pygame.Rect) -> np.ndarray:
    return pygame.surfarray.array3d(person.window.painter.surface.subsurface(area))


def test_contact_is_heard_once_each_time_it_begins(monkeypatch):
    heard: list[bool] = []
    tone = sound.ContactTone()
    monkeypatch.setattr(tone, "play", lambda: heard.append(True))
    for steps, contact in enumerate([0.0, 0.01, 0.05, 0.3, 0.0, 0.04]):
        tone.update(contact, steps)
    assert len(heard) == 2
    tone.on = False
    tone.update(0.0, 7)
    tone.update(0.5, 8)
    assert len(heard) == 2
    samples = sound.tone().astype(float)
    assert 0.1 < np.abs(samples).max() / 32767 < 0.5
    assert abs(samples[0]) < 10, "it does not click"
    assert np.abs(np.fft.rfft(samples)).argmax() * sound.RATE_HZ / len(samples) == pytest.approx(sound.TONE_HZ, abs=10)


def test_nothing_is_alarming_at_rest(sit_down):
    """Red and amber mean that something is wrong or needs the person."""
    person = sit_down("pickers", "keyboard")
    person.wait(lambda: person.status.ready, "the cloth")
    person.look()
    shown = [fact.color for fact in person.window.contents.facts()] + [panels.headline(person.status)[2]]
    assert not {style.WARNING, style.WORD} & {*shown, person.window.contents.message()[1]}
    word = picture(person, person.window.painter.layout.word)
    assert not (word == style.WORD).all(axis=-1).any(), "none is no warning"
    for color in (style.TEXT, style.QUIET, style.ACCENT, style.CONTACT, style.WORD, style.WARNING, style.HUMAN):
        assert contrast(color, style.CARD) >= 4.5


def test_the_window_shows_who_is_in_control(sit_down):
    person = sit_down("pickers", "gamepad", policy=PolicySpec(builtin="scripted"), speed=1.0)
    contents, pad = person.window.contents, person.plug_in()
    person.begin()
    person.wait(lambda: person.status.controller == "scripted" and person.status.steps >= 3, "the policy")
    assert panels.headline(person.status)[1] == "scripted places"
    assert not any(contents.past.human)
    pad.axis("left_x", -1.0)
    person.wait(lambda: person.status.controller == "you", "control")
    person.wait(lambda: any(contents.past.human), "the curve")
    assert panels.headline(person.status)[1:] == ("You are in control", style.HUMAN)
    person.look()
    band = picture(person, person.window.painter.layout.contact)
    assert (band == style.HUMAN).all(axis=-1).any()
    pad.axis("left_x", 0.0)
    person.wait(lambda: person.status.controller == "scripted", "its return")
    person.window.close()
    (episode,) = stored_episodes(contents.request.session)
    assert episode.source == "scripted+gamepad"
    assert any(step.intervention for step in episode.steps)


@pytest.mark.parametrize(
    ("phase", "controller", "words"),
    [
        ("place", "word", "word places"),
        ("disturb", "", "word waits until the cloth rests"),
        ("repair", "word", "word repairs"),
        ("place", "you", "You are in control"),
        ("repair", "you", "You are in control"),
    ],
)
def test_the_headline_says_who_acts(phase, controller, words):
    status = SessionStatus(mode="correct", state="running", phase=phase, policy="word", controller=controller)
    assert panels.headline(status)[1] == words


@pytest.mark.parametrize("success", [False, True])
def test_a_cloth_that_is_not_flat_is_not_shown_as_success(success):
    """The policy has stopped; that says nothing of the cloth."""
    verdict = judge(0.36, 0.82, success, None)
    status = SessionStatus(mode="place", state="stopped", verdict=verdict, contact=0.36, policy="word")
    sign, words, color = panels.headline(status)
    assert words == f"Stopped: {verdict.words}"
    assert (sign, color) == (("✓", style.CONTACT) if success else ("■", style.WORD))


def test_without_a_pad_the_window_does_not_say_to_press_one(sit_down):
    person = sit_down("hanger", "gamepad")
    contents = person.window.contents
    person.wait(lambda: person.status.ready and bool(person.status.problem), "the cloth")
    person.look()
    large, small = panels.banner(person.status, contents.start_key(), contents.problem())
    assert large == "No gamepad is plugged in"
    assert "Cross" not in small
    assert panels.headline(person.status)[1] == "Not ready"
    person.plug_in()
    person.wait(lambda: panels.headline(person.status)[1] == "Ready", "the pad")
    assert panels.banner(person.status, contents.start_key(), contents.problem())[0] == "Ready"


def test_a_key_that_discards_can_be_taken_back(sit_down):
    """x lies between the keys of motions."""
    person = sit_down("hanger", "keyboard")
    person.wait(lambda: person.state == "waiting" and person.status.ready, "the cloth")
    person.key(pygame.K_RETURN)
    person.wait(lambda: person.state in ("still", "running"), "the countdown")
    person.hold(pygame.K_DOWN)
    person.wait(lambda: person.status.steps >= 6, "some steps")
    person.release(pygame.K_DOWN)
    person.key(pygame.K_x)
    person.wait(lambda: person.status.discarded is not None, "it to be gone")
    steps = person.status.discarded[1]
    assert steps >= 6
    person.look()
    assert any("bring back" in hint.text for _, hint in person.window.painter.hints)
    person.key(pygame.K_u)
    person.wait(lambda: person.status.steps == steps, "it to be back")
    assert person.status.discarded is None


def test_the_best_demonstration_is_shown_beside_the_cloth(sit_down, tmp_path, make_episode, lying):
    with SessionRecorder(tmp_path / "s.h5", robot=PICKERS, cloth="towel", descriptor="word-axial") as recorder:
        for seed in range(2):
            made = make_episode(robot="pickers", seed=seed, descriptor="word-axial", disturbed=False)
            recorder.save(lying(made, 55))
    person = sit_down("pickers", "keyboard", seed=7)
    ghost, view = person.window.ghost, person.window.painter.layout.view
    person.wait(lambda: person.status.ready and person.seen() is not None, "the cloth")
    person.look()
    before = picture(person, view)
    person.press("G")
    person.look()
    assert ghost.nodes is not None
    assert ghost.nodes.shape == person.seen().nodes.shape
    assert np.any(picture(person, view) != before, axis=2).sum() > 100
    person.key(pygame.K_g)
    person.look()
    assert ghost.nodes is None
