"""Cloth and words of the terminal: they fit at any size, tell how the cloth lies, and leave no ghosts."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.effects import effects
from layflat.app.workstation.session.status import Message, SessionStatus
from layflat.app.workstation.teleop.keyboard import COMMANDS, LABELS, key_help
from layflat.app.workstation.teleop.teleop_input import zero_input
from layflat.app.workstation.terminal import display as display_module
from layflat.app.workstation.terminal.display import TerminalDisplay
from layflat.app.workstation.terminal.panel import panel, status_line
from layflat.app.workstation.terminal.side_view import side_view
from layflat.sim.cloth.registry import cloth_spec
from layflat.tests.factories import PICKERS, ROBOT_SPECS

HANGING = initial_frame("pickers", "towel")
FLAT = replace(HANGING, nodes=cloth_spec("towel").flat_nodes())
RUNNING = SessionStatus(state="running", steps=42, time_s=4.2, contact=0.36, file="demos.h5", target=20)
RUNNING = replace(RUNNING, effects=effects(RUNNING))


def inked(lines: list[str]) -> np.ndarray:
    """Return where there is cloth, (rows, columns), without the table."""
    return np.array([[c not in " ▼V" for c in line] for line in lines[:-1]])


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize(("columns", "rows"), [(46, 13), (39, 9), (90, 24)])
def test_a_hanging_cloth_is_high_and_a_flat_one_lies_on_the_table(columns, rows, plain):
    hanging, flat = (side_view(frame, columns, rows, plain=plain) for frame in (HANGING, FLAT))
    for lines in (hanging, flat):
        assert [len(line) for line in lines] == [columns] * rows
        assert any(mark in "".join(lines) for mark in "▼V")
        assert not plain or all(line.isascii() for line in lines)
    high, wide = (np.ptp(np.nonzero(inked(hanging).any(axis=axis))[0]) for axis in (1, 0))
    assert high >= 0.3 * rows
    assert wide <= 1
    low = inked(flat)
    assert not low[:-1].any()
    assert low[-1].sum() >= 0.15 * columns
    # Lengths agree: what hangs is as long as what lies, a character being twice as high as wide.
    assert low[-1].sum() == pytest.approx(2 * (high + 1), abs=3)


@given(columns=st.integers(1, 200), rows=st.integers(1, 60), plain=st.booleans(), frame=st.sampled_from([None, FLAT]))
def test_lines_fit_into_a_terminal_of_any_size(columns, rows, plain, frame):
    lines = panel(RUNNING, zero_input(PICKERS), key_help(PICKERS), frame, columns=columns, rows=rows, plain=plain)
    assert len(lines) <= max(rows - 1, 1)
    assert all(len(line) < columns for line in lines)


@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (40, 40), (132, 43)])
def test_every_key_with_an_effect_is_shown(robot, columns, rows):
    words = " ".join(panel(RUNNING, zero_input(robot), key_help(robot), FLAT, columns=columns, rows=rows, plain=True))
    for key, command in COMMANDS.items():
        if RUNNING.effect(command) is not None:
            assert re.search(rf"\b{LABELS.get(key, key)} \w", words), command
    assert "RECORDING" in words
    assert "contact  36 %" in words
    one_line = status_line(RUNNING, zero_input(robot), key_help(robot))[:79]
    assert "y keep as success" in one_line or "Space pause" in one_line


class Screen(io.StringIO):
    """A terminal of so many columns and rows, which moves its lines about when its size changes."""

    encoding = "utf-8"

    def __init__(self, columns: int, rows: int) -> None:
        super().__init__()
        self.size = (columns, rows)
        self.lines, self.at = [""], [0, 0]

    def isatty(self) -> bool:
        return True

    def resize(self, columns: int, rows: int) -> None:
        """Wrap all lines again, as most terminals do."""
        self.size = (columns, rows)
        self.lines = [line[k : k + columns] for line in self.lines for k in range(0, max(len(line), 1), columns)]
        self.lines = self.lines[-rows:]
        self.at = [len(self.lines) - 1, 0]

    def write(self, text: str) -> int:
        for part in re.findall(r"\x1b\[\d*[A-Z]|[^\x1b]", text):
            self._take(part)
        return len(text)

    def _take(self, part: str) -> None:
        row, column = self.at
        if part == "\n":
            self.at = [row + 1, 0]
        elif part == "\r":
            self.at = [row, 0]
        elif part == "\x1b[H":
            self.at = [0, 0]
        elif part == "\x1b[2J":
            self.lines = [""]
        elif part.startswith("\x1b") and part.endswith("A"):
            self.at = [max(row - int(part[2:-1]), 0), column]
        elif part == "\x1b[K":
            self.lines[row] = self.lines[row][:column]
        elif part == "\x1b[J":
            self.lines = [*self.lines[:row], self.lines[row][:column]]
        else:
            assert len(part) == 1, part
            self.lines[row] = self.lines[row].ljust(column)[:column] + part + self.lines[row][column + 1 :]
            self.at = [row, column + 1]
        while self.at[0] >= len(self.lines):
            self.lines.append("")
        while len(self.lines) > self.size[1]:
            del self.lines[0]
            self.at[0] -= 1


def test_a_change_of_size_leaves_no_ghost_and_loses_no_line(monkeypatch):
    screen = Screen(80, 30)
    monkeypatch.setattr(display_module.select, "select", lambda *_: ([], [screen], []))
    monkeypatch.setattr(TerminalDisplay, "_columns_rows", lambda _: screen.size)
    now = iter(range(1000))
    shown = TerminalDisplay(screen, key_help(PICKERS), clock=lambda: float(next(now)))
    for columns, rows in ((80, 30), (40, 30), (100, 20), (30, 12), (80, 30)):
        if screen.size != (columns, rows):
            screen.resize(columns, rows)
        for k in range(3):
            status = replace(RUNNING, steps=k + columns, message=Message(text=f"kept demo_{columns}"))
            shown.show(status, zero_input(PICKERS), FLAT)
        seen = "\n".join(screen.lines)
        assert seen.count("[RECORDING]") == 1, seen
        assert seen.count("contact") == 1, seen
        assert f"kept demo_{columns}" in seen
        assert f"{2 + columns} steps" in seen
    shown.clear()
    kept = [line for line in screen.lines if line]
    assert kept == [f"kept demo_{columns}" for columns in (80, 40, 100, 30, 80)][-len(kept) :]
    assert len(kept) >= 3
