"""Pages of the browser workstation. A new one adds a file and a line here."""

from collections.abc import Mapping

from layflat.app.workstation.web.pages.data import DataPage
from layflat.app.workstation.web.pages.evaluate import EvaluatePage
from layflat.app.workstation.web.pages.place import PlacePage
from layflat.app.workstation.web.pages.record import RecordPage
from layflat.app.workstation.web.pages.replay import ReplayPage
from layflat.app.workstation.web.pages.settings import SettingsPage
from layflat.app.workstation.web.pages.train import TrainPage
from layflat.app.workstation.web.viewer import Page

PAGES: Mapping[str, type[Page]] = {
    page.name: page for page in (RecordPage, TrainPage, PlacePage, ReplayPage, DataPage, EvaluatePage, SettingsPage)
}
"""Every page by its name, in the order of the tabs."""
