"""`layflat app`: serve the workstation to browsers until the program is interrupted."""

from __future__ import annotations

import contextlib
import sys
import tempfile
import threading
import warnings
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import viser

from layflat.app.support.errors import INTERRUPTED, UsageError
from layflat.app.workers.sim_options import parse_conditions
from layflat.app.workstation.session.client import start_fork_server
from layflat.app.workstation.stop_signals import stop_on_signals
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.operations import Commands
from layflat.app.workstation.web.pages import PAGES
from layflat.app.workstation.web.security import open_server
from layflat.app.workstation.web.stage import add_stage
from layflat.app.workstation.web.viewer import Viewer, configure_theme
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
    settings: tuple[str, ...] = ()
    """Conditions of what is simulated, KEY=VALUE."""
    debug: bool = False
    commands: Commands = field(default_factory=dict)
    """Commands of `layflat data` by name, which the page Data offers."""


def app(config: AppConfig) -> int:
    """Serve the workstation on the sessions and models in a folder; return the exit status."""
    check_folder(config.folder)
    conditions = parse_conditions(config.settings)
    with tempfile.TemporaryDirectory(prefix="layflat-") as scratch:
        folder = Folder(config.folder.resolve())
        workstation = Workstation(
            folder, Path(scratch), make_viewer, config.debug, config.commands, conditions=conditions
        )
        with serve(workstation, config) as address:
            print(f"workstation: {address}", flush=True)
            if folder.read_only:
                print(f"layflat: {config.folder} cannot be written; it can only be looked at", file=sys.stderr)
            if config.open_browser and has_display():
                threading.Thread(target=open_browser, args=(address,), daemon=True).start()
            with stop_on_signals(impatient=False) as stopped:
                while not stopped():
                    workstation.round()
    return INTERRUPTED


def make_viewer(workstation: Workstation, client: viser.ClientHandle) -> Viewer:
    """Make the viewer of a client, with all pages."""
    return Viewer(workstation, client, PAGES)


def open_browser(address: str) -> None:
    """Open the address in a browser; say so where there is none."""
    if not webbrowser.open(address):
        print("layflat: no browser could be opened; open the address above yourself", file=sys.stderr)


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
        configure_theme(server.gui, dark=False)
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
