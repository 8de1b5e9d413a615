"""Every page by its name, in the order of the tabs. A new one adds a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from layflat.app.workstation.web.pages.data import DataPage
from layflat.app.workstation.web.pages.page import Page
from layflat.app.workstation.web.pages.replay import ReplayPage
from layflat.app.workstation.web.pages.settings import SettingsPage

PAGES: Mapping[str, type[Page]] = {page.name: page for page in (ReplayPage, DataPage, SettingsPage)}
