"""What the window can be used for, one file each. A new mode adds a file and a line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from layflat.app.workstation.window.pages.data import DataPage
from layflat.app.workstation.window.pages.page import Page, WindowContext
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.pages.record import RecordPage
from layflat.app.workstation.window.pages.replay import ReplayPage
from layflat.app.workstation.window.pages.settings import SettingsPage
from layflat.app.workstation.window.pages.train import TrainPage

if TYPE_CHECKING:
    from layflat.app.workstation.window.input_manager import InputManager

__all__ = ["Page", "WindowContext", "all_pages"]


def all_pages(shop: WindowContext, hands: InputManager) -> list[Page]:
    """In the order of their tabs."""
    return [
        RecordPage(shop, hands=hands),
        TrainPage(shop),
        PlacePage(shop, hands=hands),
        PlacePage(shop, name="Disturb", hurry=True),
        ReplayPage(shop),
        DataPage(shop),
        SettingsPage(shop),
    ]
