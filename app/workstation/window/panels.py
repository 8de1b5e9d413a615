"""Words of the window: state, numbers, newest sentence and key chips, each wrapped into the room that there is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple

import pygame

from layflat.app.workstation.session.status import YOU, Level, SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.app.workstation.window import style
from layflat.app.workstation.window.style import Canvas


class KeyHint(NamedTuple):
    """A button: its name, its effect now, and a function for a click on it."""

    key: str
    text: str
    press: Callable[[], object] | None = None
    color: style.Color = style.TEXT


class Fact(NamedTuple):
    """A number and its name."""

    name: str
    value: str
    color: style.Color = style.TEXT


LEVELS: dict[Level, style.Color] = {
    "info": style.QUIET, "success": style.CONTACT, "warning": style.WORD, "error": style.WARNING,
}  # fmt: skip
COMMAND_COLORS = {Command.START: style.ACCENT, Command.KEEP_SUCCESS: style.CONTACT, Command.KEEP_FAILURE: style.WORD}
_STATES = {
    "starting": ("○", "Starting the simulation", style.QUIET),
    "countdown": ("○", "Get ready", style.ACCENT),
    "still": ("▶", "Go: starts when you move", style.ACCENT),
    "paused": ("‖", "Paused", style.WORD),
    "finished": ("■", "Keep it?", style.ACCENT),
    "over": ("■", "Ended", style.QUIET),
}
"""Sign, words and colour of states; each has a sign of its own beside its colour."""
TOP_TEXT, FACT_TEXT, NAME_TEXT, MESSAGE_TEXT = 19, 15, 11, 13
HEADLINE_WIDTH = 300
"""Width at scale 1 that the state needs in any case; what it says is smaller where it is longer."""
STRIP_SHARE = 0.25
"""Share of the window's height above which the strip's letters are made smaller."""


def headline(status: SessionStatus) -> tuple[str, str, style.Color]:
    """Return sign, words and colour of the state."""
    verdict = status.verdict
    if status.state == "asking":
        return "?", "Keep it?", style.WORD
    if status.state == "waiting" and status.problem:
        return "○", "Not ready", style.WORD
    if status.state == "waiting":
        return ("○", "Ready", style.TEXT) if status.ready else ("○", "Hanging the cloth", style.QUIET)
    if status.state == "running":
        if status.policy and status.controller != YOU:
            doing = {"disturb": "waits until the cloth rests", "repair": "repairs"}.get(status.phase, "places")
            return "●", f"{status.policy} {doing}", style.ACCENT
        return "●", "You are in control" if status.policy else "Recording", style.HUMAN if status.policy else style.TEXT
    if status.state in ("stopped", "finished") and verdict is not None:
        color = style.CONTACT if verdict.success else style.WORD
        return "✓" if verdict.success else "■", f"Stopped: {verdict.words}", color
    if status.state == "stopped":
        return "■", f"Stopped: {100 * status.contact:.0f} %", style.TEXT
    return _STATES.get(status.state, _STATES["starting"])


def facts(status: SessionStatus, *, place: str, device: str) -> list[Fact]:
    """Return the numbers; ``place`` is the file and what it holds."""
    by = "+".join(filter(None, (status.policy, status.source)))
    made = [*status.disturbances, *([f"your pull, {status.drag_steps} steps"] if status.drag_steps else [])]
    more = [("partial", status.counts["partial"]), ("discarded", status.counts["discarded"])]
    found = [
        Fact("contact", f"{100 * status.contact:.0f} %", style.CONTACT),
        Fact("flat area", f"{status.flat_area:.2f}"),
        Fact("time", f"{status.time_s:.1f} s, {status.steps} steps"),
        Fact("seed", str(status.seed)),
        *([Fact("kept", status.progress)] if status.recording else []),
        *(Fact(name, str(count)) for name, count in more if count),
        Fact("by", by),
        *([Fact("you", f"{status.intervention_steps} steps", style.HUMAN)] if status.intervention_steps else []),
        *([Fact("disturbed", ", ".join(made))] if made else []),
        *([Fact("device", device)] if device else []),
        Fact("file", place),
    ]
    if status.verdict is not None and status.state in ("waiting", "countdown"):
        found.append(Fact("last", status.verdict.words, style.CONTACT if status.verdict.success else style.TEXT))
    if status.real_time_factor:
        found.append(Fact("speed", f"{status.real_time_factor:.2f} × real time"))
    return found


def banner(status: SessionStatus, start_key: str, problem: str) -> tuple[str, str]:
    """Return large words over the view, and small ones below them; ``problem``: why the device is disconnected."""
    state, message = status.state, status.message.text
    if state == "waiting" and problem:
        what, _, advice = problem.partition("; ")
        return what[:1].upper() + what[1:], advice
    if state == "waiting":
        return ("Ready", f"{start_key}: {status.effect(Command.START) or 'start'}") if status.ready else ("", "")
    if state == "countdown":
        return (str(max(1, round(0.5 + status.countdown_s - 1e-6))), "") if status.ready else ("", "")
    if state == "asking":
        return "Keep it?", status.question
    if state == "paused":
        return "Paused", message.removeprefix("paused: ").removeprefix("paused")
    return ("Go", "starts when you move") if state == "still" else ("", "")


def device_hints(buttons: Iterable[Button], status: SessionStatus, press: Callable[[Command], object]) -> list[KeyHint]:
    """Return a device's buttons that have an effect now, then its motions."""
    commands, motions = [], []
    for button in buttons:
        if button.command is None:
            motions.append(KeyHint(button.name, button.text))
        elif effect := status.effect(button.command):
            color = COMMAND_COLORS.get(button.command, style.TEXT)
            commands.append(KeyHint(button.name, effect, partial(press, button.command), color))
    return commands + motions


# Drawing


def flow(widths: Sequence[int], room: int, gap: int, pitch: int) -> tuple[list[tuple[int, int]], int]:
    """Return the places of items in lines that fit into ``room`` px, and the height of all lines."""
    places, x, y = [], 0, 0
    for width in widths:
        if x and x + width > room:
            x, y = 0, y + pitch
        places.append((x, y))
        x += width + gap
    return places, y + pitch if widths else 0


def top_has_room(canvas: Canvas, hints: Sequence[KeyHint]) -> bool:
    """Return whether keys have room beside the state."""
    return canvas.area.width - _keys_width(canvas, hints) >= canvas.px(HEADLINE_WIDTH)


def _keys_width(canvas: Canvas, hints: Sequence[KeyHint]) -> int:
    return sum(canvas.key_width(hint.key, hint.text) + canvas.px(16) for hint in hints)


def draw_top(canvas: Canvas, status: SessionStatus, hints: Sequence[KeyHint]) -> list[pygame.Rect]:
    """Draw the state, and keys at its right; return their areas."""
    canvas.surface.fill(style.BACKGROUND)
    sign, words, color = headline(status)
    middle, px = canvas.area.centery, canvas.px
    sign_area = canvas.text(sign, (px(4), middle), TOP_TEXT, color, bold=True, align="midleft")
    left = canvas.area.width - _keys_width(canvas, hints) + px(16)
    room = (left if hints else canvas.area.width) - sign_area.right - px(24)
    size = float(TOP_TEXT)
    while size > 8 and canvas.width(words, size, bold=True) > room:
        size -= 0.5
    canvas.text(words, (sign_area.right + px(8), middle), size, style.TEXT, bold=True, align="midleft")
    x, areas = left, []
    for hint in hints:
        areas.append(canvas.key((x, middle - px(style.KEY_HEIGHT) // 2), hint.key, hint.text, hint.color))
        x = areas[-1].right + px(16)
    return areas


def _fact_widths(canvas: Canvas, shown: Sequence[Fact]) -> list[int]:
    """Return widths of the cells, in steps: a number that changes does not move those beside it."""
    step = canvas.px(24)
    wide = [max(canvas.width(f.value, FACT_TEXT), canvas.width(f.name, NAME_TEXT)) for f in shown]
    return [min(-(-(width + canvas.px(6)) // step) * step, canvas.area.width) for width in wide]


def facts_height(canvas: Canvas, shown: Sequence[Fact]) -> int:
    """Return the height that the numbers take, px."""
    return flow(_fact_widths(canvas, shown), canvas.area.width, canvas.px(8), canvas.px(38))[1]


def draw_facts(canvas: Canvas, shown: Sequence[Fact]) -> None:
    """Draw numbers below their names."""
    canvas.surface.fill(style.BACKGROUND)
    widths, px = _fact_widths(canvas, shown), canvas.px
    places, _ = flow(widths, canvas.area.width, px(8), px(38))
    for fact, (x, y), width in zip(shown, places, widths, strict=True):
        canvas.text(fact.name, (x + px(4), y), NAME_TEXT, style.QUIET)
        canvas.block(fact.value, pygame.Rect(x + px(4), y + px(14), width, px(22)), FACT_TEXT, fact.color)


def message_height(canvas: Canvas, message: str) -> int:
    """Return the height that the newest sentence takes, px."""
    return len(canvas.wrap(message, MESSAGE_TEXT, canvas.area.width)) * canvas.pitch(MESSAGE_TEXT)


def draw_message(canvas: Canvas, message: str, color: style.Color) -> None:
    """Draw the newest sentence."""
    canvas.surface.fill(style.BACKGROUND)
    canvas.block(message, canvas.area, MESSAGE_TEXT, color)


def hints_scale(canvas: Canvas, hints: Sequence[KeyHint], max_height: int) -> tuple[float, int]:
    """Return the scale at which all hints fit, and the height that they take then, px."""
    scale = canvas.scale
    while True:
        smaller = Canvas(canvas.surface, scale)
        height = _place_hints(smaller, hints, canvas.area.width)[1]
        if height <= max_height or scale < 0.75 * canvas.scale:
            return scale, height
        scale *= 0.94


def _place_hints(canvas: Canvas, hints: Sequence[KeyHint], width: int) -> tuple[list[tuple[int, int]], int]:
    px = canvas.px
    widths = [canvas.key_width(hint.key, hint.text) for hint in hints]
    places, height = flow(widths, width - 2 * px(12), px(18), px(29))
    return [(x + px(12), y + px(8)) for x, y in places], height + px(12)


def draw_hints(canvas: Canvas, hints: Sequence[KeyHint], scale: float) -> list[pygame.Rect]:
    """Draw all key chips; return their areas."""
    canvas.surface.fill(style.BACKGROUND)
    canvas.card()
    smaller = Canvas(canvas.surface, scale)
    places, _ = _place_hints(smaller, hints, canvas.area.width)
    return [smaller.key(at, hint.key, hint.text, hint.color) for at, hint in zip(places, hints, strict=True)]


def draw_banner(canvas: Canvas, large: str, small: str, *, low: bool) -> None:
    """Draw words over the view, at its lower end if ``low``: never over what a hand has to take hold of."""
    if not large:
        return
    px, view = canvas.px, canvas.area
    size = 56 if len(large) <= 3 else 24
    lines = canvas.wrap(small, 14, view.width - px(60)) if small else []
    width = max([canvas.width(large, size, bold=True), *(canvas.width(line, 14) for line in lines)]) + px(48)
    area = pygame.Rect(0, 0, min(width, view.width), px(size * 1.25) + len(lines) * canvas.pitch(14) + px(16))
    area.midtop = (view.centerx, view.bottom - px(12) - area.height if low else view.top + px(40))
    veil = pygame.Surface(area.size, pygame.SRCALPHA)
    pygame.draw.rect(veil, (*style.BACKGROUND, 215), veil.get_rect(), border_radius=px(12))
    canvas.surface.blit(veil, area)
    title = canvas.text(large, (area.centerx, area.top + px(6)), size, style.TEXT, bold=True, align="midtop")
    for k, line in enumerate(lines):
        canvas.text(line, (area.centerx, title.bottom + k * canvas.pitch(14)), 14, style.QUIET, align="midtop")


def draw_view_keys(canvas: Canvas, hints: Sequence[KeyHint]) -> list[pygame.Rect]:
    """Draw the keys of the views in the view's upper left corner; return their areas."""
    px, small = canvas.px, Canvas(canvas.surface, 0.85 * canvas.scale)
    widths = [small.key_width(hint.key, hint.text) for hint in hints]
    places, _ = flow(widths, canvas.area.width - 2 * px(8), px(10), px(24))
    return [small.key((x + px(8), y + px(8)), h.key, h.text, h.color) for (x, y), h in zip(places, hints, strict=True)]


def draw_band(canvas: Canvas, band: tuple[tuple[int, int], tuple[int, int], float], corner: tuple[int, int]) -> None:
    """Draw how far a drag is, and how far it is at full speed."""
    a, b = (pygame.Vector2(place) - corner for place in band[:2])
    reach = band[2]
    pygame.draw.circle(canvas.surface, style.QUIET, a, reach, canvas.px(1))
    pygame.draw.line(canvas.surface, style.ACCENT, a, b, canvas.px(4))
    pygame.draw.circle(canvas.surface, style.TEXT, b, canvas.px(6))
    share = min(a.distance_to(b) / reach, 1.0)
    canvas.text(f"{100 * share:.0f} %", (int(b.x) + canvas.px(12), int(b.y)), 13, style.TEXT, bold=True)
