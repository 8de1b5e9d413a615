"""Operations: every command of `layflat data`, as a form, by what the command line itself says of its options."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from layflat.app.support.errors import UsageError
from layflat.app.workstation.web.folder import Folder
from layflat.data.format.schema import demo_number

if TYPE_CHECKING:
    import click

Commands: TypeAlias = "Mapping[str, click.Command]"
ANY = "any"
HIDDEN = ("json", "force", "debug", "help", "path")
"""Parameters that the page has elsewhere, or does not need."""


def fields(command: click.Command) -> list[click.Parameter]:
    """Return the parameters that a form of the command has."""
    return [param for param in command.params if param.name not in HIDDEN]


def is_file(param: click.Parameter) -> bool:
    """Return whether a parameter names what is written."""
    return param.name == "out"


def default(param: click.Parameter, command: str, stem: str) -> str:
    """Return the text that stands in the field at first."""
    if is_file(param):
        return f"{stem}-{command}{Path(str(param.metavar)).suffix}" if param.required else ""
    return "" if param.default is None or callable(param.default) else str(param.default)


def arguments_of(
    command: click.Command, folder: Folder, session: str, values: Mapping[str, Any], *, force: bool
) -> list[str]:
    """Return the command line with the values of its fields, each of which stays in the folder."""
    found = ["data", str(command.name), str(folder.path / session)]
    for param in fields(command):
        value = values.get(str(param.name), "")
        if isinstance(value, bool):
            found += [(param.opts if value else param.secondary_opts)[0]] if value != param.default else []
            continue
        option, value = param.opts[0], str(value).strip()
        if not value or value == ANY:
            continue
        if value.startswith("-"):
            raise UsageError(f"{param.name} is {value!r}; give a value without a leading -")
        if param.name == "paths":
            found.insert(3, str(folder.session(value)))
        elif param.name == "episode":
            found += [option, str(demo_number(value))]
        elif param.multiple:  # type: ignore[attr-defined]
            found += [word for part in value.split(",") for word in (option, part.strip())]
        else:
            found += [option, str(folder.new(value)) if is_file(param) else value]
    return [*found, *(["--force"] if force and any(is_file(param) for param in command.params) else [])]
