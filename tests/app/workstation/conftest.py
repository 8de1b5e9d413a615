"""Fixtures of the workstation's tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from layflat.tests.app.workstation.fakes import FakeTeleoperator, Recording
from layflat.tests.virtual_pad import VirtualPad, plugged


@pytest.fixture
def teleoperator() -> FakeTeleoperator:
    return FakeTeleoperator()


@pytest.fixture
def record(tmp_path) -> Iterator[Callable[..., Recording]]:
    """``record(**options of Recording)``: a session that records into s.h5, or not, with ``session=None``."""
    made: list[Recording] = []

    def make(**options) -> Recording:
        made.append(Recording(options.pop("session", tmp_path / "s.h5"), **options))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def plug(monkeypatch, tmp_path) -> Iterator[Callable[..., VirtualPad]]:
    """``plug(axes, buttons, hats, known=True, name=...)``: a gamepad; the user's own mappings are not used."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    with ExitStack() as stack:
        yield lambda *counts, **options: stack.enter_context(plugged(*(counts or (6, 16, 0)), **options))
