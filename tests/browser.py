"""A page as headless Chromium shows it."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
HEIGHT = 1600
MEASURE = """<script>
const wide = [...document.querySelectorAll('*')].filter(e => !e.closest('.scroll') && e.getBoundingClientRect().right
  > document.documentElement.clientWidth + 1).length;
const cut = [...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > e.clientWidth + 1).length;
const broken = [...document.images].filter(e => e.complete && !e.naturalWidth).length;
document.body.dataset.found = JSON.stringify({
  overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth, wide, cut, broken});
</script>"""


def measured(page: Path, folder: Path, width: int) -> dict[str, int]:
    """How far the page is wider than its window (px), how many elements reach beyond it, how many tables have to be
    scrolled, and how many pictures are broken; an error or a warning on the console is an AssertionError."""
    copy = folder / "measured.html"
    copy.write_text(page.read_text(encoding="utf-8").replace("</body>", MEASURE + "</body>"), encoding="utf-8")
    shown = subprocess.run(
        [*_command(folder, width), "--dump-dom", copy.as_uri()], check=True, capture_output=True, timeout=100, text=True
    )
    assert "CONSOLE" not in shown.stderr, shown.stderr
    found = re.search(r"data-found=\"([^\"]*)\"", shown.stdout)
    assert found is not None
    return dict(json.loads(html.unescape(found[1])))


def screenshot(page: Path, folder: Path, width: int) -> np.ndarray:
    """(HEIGHT, width, 3) uint8."""
    shot = folder / "page.png"
    command = [*_command(folder, width), f"--screenshot={shot}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=100)
    return cv2.imread(str(shot))


def _command(folder: Path, width: int) -> list[str]:
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    return [
        *command,
        f"--user-data-dir={folder / 'profile'}",
        f"--window-size={width},{HEIGHT}",
        "--enable-logging=stderr",
    ]
