"""Panel: what a terminal shows of a session, in lines that fit: the cloth, numbers, and what each key does now."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import zip_longest

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.app.workstation.terminal.side_view import side_view

WORDS, PICTURE_MOST, PICTURE_SHAPE = 32, 92, 0.29
"""Columns of the words beside the cloth's picture, and columns and shape (rows over columns) of the picture."""
BESIDE, LOW = 78, 8
"""Columns from which the words stand beside the picture, and rows up to which there is one line only."""
SHORT = 26
"""Longest effect of a key that is written out."""
BAR = 14


def status_line(status: SessionStatus, teleop: TeleopInput, buttons: Sequence[Button] = ()) -> str:
    """Return state, numbers and available keys on one line."""
    return "  ".join([f"[{headline(status)}]", *_numbers(status, teleop), *key_texts(status, buttons)])


def headline(status: SessionStatus) -> str:
    """Return the state."""
    return {
        "waiting": f"seed {status.seed} " + ("hangs" if status.ready else "is being hung"),
        "countdown": f"starts in {status.countdown_s:.0f}" if status.ready else "hanging the cloth",
        "still": "move to continue" if status.steps else "move to start",
        "running": "RECORDING" if status.recording else "running",
        "asking": "keep it?",
    }.get(status.state, status.state)


def _numbers(status: SessionStatus, teleop: TeleopInput) -> list[str]:
    kept = [f"kept {status.progress}"] if status.recording else []
    return [
        f"{status.steps} steps",
        f"contact {100 * status.contact:.0f} %",
        f"speed {100 * teleop.speed:.0f} %",
        *kept,
    ]


def key_texts(status: SessionStatus, buttons: Sequence[Button]) -> list[str]:
    """Return the keys that do something now, each with its effect."""
    found = []
    for button in buttons:
        effect = None if button.command is None else status.effect(button.command)
        if effect is not None and button.command is not None:
            found.append(f"{button.name} {effect if len(effect) <= SHORT else button.command.value}")
    return found


def panel(
    status: SessionStatus,
    teleop: TeleopInput,
    buttons: Sequence[Button],
    frame: SimulationFrame | None,
    *,
    columns: int,
    rows: int,
    plain: bool,
) -> list[str]:
    """Return lines of fewer than ``columns`` characters, fewer than ``rows``; the numbers in the first."""
    width = columns - 1
    if rows < LOW or width < 20:
        return [status_line(status, teleop, buttons)[: max(width, 0)]]
    beside = columns >= BESIDE
    wide = min(width - WORDS - 2, PICTURE_MOST) if beside else width
    words = _words(status, teleop, buttons, width - wide - 2 if beside else width, plain=plain)
    height = min(round(PICTURE_SHAPE * wide), rows - 2 - (0 if beside else len(words)))
    if frame is None or height < 5:
        return [line[:width] for line in words[: rows - 1]]
    picture = side_view(frame, wide, height, plain=plain)
    if not beside:
        return [*picture, *words][: rows - 1]
    pairs = zip_longest(picture, words, fillvalue="")
    return [f"{left:{wide}}  {right}".rstrip()[:width] for left, right in pairs][: rows - 1]


def _words(
    status: SessionStatus, teleop: TeleopInput, buttons: Sequence[Button], width: int, *, plain: bool
) -> list[str]:
    full, empty = ("#", ".") if plain else ("█", "░")
    n_full = round(BAR * min(max(status.contact, 0.0), 1.0))
    steps, _, speed, *kept = _numbers(status, teleop)
    lines = [
        f"[{headline(status)}]",
        f"contact {100 * status.contact:3.0f} % {full * n_full}{empty * (BAR - n_full)}",
        f"{steps}, {status.time_s:.1f} s, flat area {status.flat_area:.2f}",
        ", ".join([speed, *kept]),
    ]
    # A non-breaking space keeps a key beside its effect.
    keys = "  ".join(text.replace(" ", "\xa0") for text in key_texts(status, buttons))
    motions = [f"{button.name}: {button.text}" for button in buttons if button.command is None]
    wrapped = [line for text in [*lines, keys, *motions] for line in textwrap.wrap(text, width)]
    return [line.replace("\xa0", " ") for line in wrapped]
