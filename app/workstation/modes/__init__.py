"""What the window can be used for, one file each. A new mode adds a file and a line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.workstation.modes.data import DataMode
from app.workstation.modes.mode import Mode, Shop
from app.workstation.modes.place import PlaceMode
from app.workstation.modes.record import RecordMode
from app.workstation.modes.replay import ReplayMode
from app.workstation.modes.settings import SettingsMode
from app.workstation.modes.train import TrainMode

if TYPE_CHECKING:
    from app.workstation.hands import Hands

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
