"""Fixtures that the tests of several packages share."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import pytest

from layflat.data.types import Episode
from layflat.tests import factories

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell that starts the tests in its background has them ignore Ctrl-C, and with them what they start.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def make_episode() -> Callable[..., Episode]:
    """``layflat.tests.factories.make_episode``."""
    return factories.make_episode


@pytest.fixture(scope="session")
def differences() -> Callable[[Any, Any], list[str]]:
    """``layflat.tests.factories.differences``."""
    return factories.differences
