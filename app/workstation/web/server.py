"""`layflat app`: serve the workstation to browsers until the program is interrupted."""

from __future__ import annotations

import contextlib
import signal
import sys
import tempfile
import threading
import warnings
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import viser

from layflat.app.support.errors import INTERRUPTED, UsageError
from layflat.app.workstation.session.client import start_fork_server
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.pages.registry import PAGES
from layflat.app.workstation.web.security import open_server
from layflat.app.workstation.web.stage import add_stage
from layflat.app.workstation.web.viewer import Viewer
from layflat.app.workstation.web.workstation import Workstation
from layflat.app.workstation.window.launch import has_display

PANEL_PX = 430
"""Width of the panel: all tabs in one row."""


@dataclass(frozen=True, kw_only=True)
class AppConfig:
    """Settings of one `layflat app` call."""

    folder: Path = Path("runs")
    host: str = "127.0.0.1"
    port: int = 8080
    open_browser: bool = True
    debug: bool = False


def app(config: AppConfig) -> int:
    """Serve the workstation on the sessions and models in a folder; return the exit status."""
    check_folder(config.folder)
    with tempfile.TemporaryDirectory(prefix="layflat-") as scratch:
        workstation = Workstation(
            Folder(config.folder.resolve()),
            Path(scratch),
            lambda shared, client: Viewer(shared, client, PAGES),
            config.debug,
        )
        run(workstation, config)
    return INTERRUPTED


def run(workstation: Workstation, config: AppConfig) -> None:
    """Serve a workstation until the program is interrupted."""
    with serve(workstation, config) as address:
        print(f"workstation: {address}", flush=True)
        if workstation.folder.read_only:
            print(f"layflat: {config.folder} cannot be written; it can only be looked at", file=sys.stderr)
        if config.open_browser and has_display():
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        with stop_signals() as stopped:
            while not stopped.is_set():
                workstation.round()


def check_folder(folder: Path) -> None:
    """Make the folder where it is missing; UsageError where that fails. One that is read-only is fine."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        next(folder.iterdir(), None)
    except OSError as error:
        raise UsageError(f"{folder} cannot be opened ({error.strerror or error}); choose another folder") from None


@contextlib.contextmanager
def serve(workstation: Workstation, config: AppConfig) -> Iterator[str]:
    """Serve a workstation, whose rounds the caller runs; yield the address."""
    safe = open_server(config.host, config.port)
    server = safe.server
    # A viewer may leave while its page is built.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
    start_fork_server()  # It imports for a second or two, while the person looks around.
    try:
        server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(PANEL_PX)
        add_stage(server)

        async def connect(client: viser.ClientHandle) -> None:
            workstation.post(lambda: workstation.connect(client))

        async def disconnect(client: viser.ClientHandle) -> None:
            workstation.post(lambda: workstation.disconnect(client.client_id))

        server.on_client_connect(connect)
        server.on_client_disconnect(disconnect)
        yield safe.address
    finally:
        workstation.close()
        server.stop()


@contextlib.contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """Note Ctrl-C, SIGTERM and the terminal's end, so that the round is completed and everything saved."""
    stopped = threading.Event()
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, lambda *_: stopped.set()) for number in numbers}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
