"""A person at the browser workstation, with real clicks and keys in the system's Chromium."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

from layflat.tests.app.program import Program  # noqa: E402
from layflat.tests.browser import CHROMIUM  # noqa: E402

PATIENCE_MS = 60_000
SOFTWARE = ("--use-gl=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


def address_of(server: Program) -> str:
    server.until("workstation: http", 90)
    found = re.search(r"workstation: (\S+)", server.out)
    assert found is not None
    return found[1]


class BrowserPerson:
    """One page in one browser."""

    def __init__(self, browser: playwright.Browser, address: str, size: tuple[int, int] = (1280, 720)) -> None:
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]})
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(address)
        self.button("Settings").wait_for()

    def button(self, name: str) -> playwright.Locator:
        """The last button whose name begins so: a page's own buttons are below the tabs."""
        return self.page.get_by_role("button", name=re.compile(f"^{re.escape(name)}")).last

    def press(self, name: str) -> None:
        self.button(name).click()

    def tab(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).first.click()
        self.page.get_by_text(name, exact=True).nth(1).wait_for()

    def choose(self, label: str, option: str) -> None:
        self.page.get_by_label(label, exact=True).first.click()
        self.page.get_by_role("option", name=option, exact=True).click()

    def write(self, label: str, text: str) -> None:
        self.field(label).fill(text)

    def field(self, label: str) -> playwright.Locator:
        return self.page.locator(f"//label[normalize-space(.)='{label}']/../../../div[2]//input").first

    def alerts(self) -> list[str]:
        """The workstation's own errors and warnings; the library has one on software rendering."""
        return list(self.page.locator("p[role=alert]").all_inner_texts())

    def sees(self, text: str, seconds: float = PATIENCE_MS / 1000) -> None:
        self.page.get_by_text(re.compile(text)).first.wait_for(timeout=1000 * seconds)

    def close(self) -> None:
        self.context.close()


def wait(until: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    give_up = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < give_up, f"waited {seconds:.0f} s for {what}"
        time.sleep(0.05)


needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
