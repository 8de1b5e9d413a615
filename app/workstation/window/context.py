"""WindowContext: what all pages of the window share; key hints and rows, which they show."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from layflat.app.workstation import settings
from layflat.app.workstation.session.activity_client import ActivityClient
from layflat.app.workstation.settings import Settings
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.app.workstation.window import style
from layflat.app.workstation.window.layout import WindowLayout
from layflat.data.names import storable


class KeyHint(NamedTuple):
    """A button: its name, its effect now, and a function for a click on it."""

    key: str
    text: str
    press: Callable[[], None] | None = None
    color: style.Color = style.TEXT


class FormRow(NamedTuple):
    """A line of a panel: a name and its value."""

    name: str
    value: str
    color: style.Color = style.TEXT


COMMAND_COLORS = {
    Command.START: style.ACCENT,
    Command.KEEP_SUCCESS: style.CONTACT,
    Command.KEEP_FAILURE: style.WORD,
    Command.DISCARD: style.WARNING,
}


def device_key_hints(
    buttons: Iterable[Button], effects: Mapping[str, str | None], press: Callable[[Command], None]
) -> list[KeyHint]:
    """Return a device's buttons that have an effect now (``effects``, by the command's name), then its motions."""
    commands, motions = [], []
    for button in buttons:
        if button.command is None:
            motions.append(KeyHint(button.name, button.text))
        elif effect := effects.get(button.command.name):
            color = COMMAND_COLORS.get(button.command, style.TEXT)
            commands.append(KeyHint(button.name, effect, partial(press, button.command), color))
    return commands + motions


@dataclass
class WindowContext:
    """Folder, settings, the activity's process and the newest message."""

    folder: Path
    settings: Settings
    remember: bool
    """Whether settings outlive the window."""
    client: ActivityClient
    layout: WindowLayout
    message: str = ""
    """Newest sentence, in the line below the view."""
    message_color: style.Color = style.QUIET

    def show_message(self, message: str, color: style.Color = style.QUIET) -> None:
        """Show a sentence below the view."""
        self.message, self.message_color = message, color

    def change_settings(self, new: Settings) -> None:
        """Take new settings, and write them where the window remembers them."""
        if new != self.settings:
            self.settings = new
            if self.remember:
                settings.save(self.folder, new)

    def send_command(self, command: Command) -> None:
        """Send a person's command to the activity."""
        self.client.request("command", name=command.name)

    def sessions(self) -> list[str]:
        """Return the session files of the folder, the newest first."""
        return _newest(self.folder, "*.h5")

    def models(self) -> list[str]:
        """Return the model files of the folder, the newest first."""
        return _newest(self.folder, "*.npz")


def _newest(folder: Path, pattern: str) -> list[str]:
    # pygame-menu cannot show a name that is not UTF-8.
    found = [path for path in folder.glob(pattern) if path.is_file() and path.name == storable(path.name)]
    return [path.name for path in sorted(found, key=lambda path: path.stat().st_mtime, reverse=True)]
