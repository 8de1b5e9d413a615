"""What the window can be used for, one file each. A new mode adds a file and a line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from layflat.app.workstation.window.pages.data import DataMode
from layflat.app.workstation.window.pages.page import Mode, Shop
from layflat.app.workstation.window.pages.place import PlaceMode
from layflat.app.workstation.window.pages.record import RecordMode
from layflat.app.workstation.window.pages.replay import ReplayMode
from layflat.app.workstation.window.pages.settings import SettingsMode
from layflat.app.workstation.window.pages.train import TrainMode

if TYPE_CHECKING:
    from layflat.app.workstation.window.input_manager import Hands

__all__ = ["Mode", "Shop", "all_modes"]


def all_modes(shop: Shop, hands: Hands) -> list[Mode]:
    """In the order of their tabs."""
    return [
        RecordMode(shop, hands=hands),
        TrainMode(shop),
        PlaceMode(shop, hands=hands),
        PlaceMode(shop, name="Disturb", hurry=True),
        ReplayMode(shop),
        DataMode(shop),
        SettingsMode(shop),
    ]
