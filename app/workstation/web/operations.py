"""Operations: every command of `layflat data`, as a form, by what the command line itself says of its options."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args, get_origin, get_type_hints

from layflat.app.support.errors import UsageError
from layflat.app.workstation.web.folder import Folder
from layflat.data.format.schema import demo_number

if TYPE_CHECKING:
    from typer.core import TyperCommand

Commands: TypeAlias = "Mapping[str, TyperCommand]"
ANY = "-"
HIDDEN = ("json", "force", "debug", "help", "path")
"""Parameters that the page has elsewhere, or does not need."""


def fields(command: TyperCommand) -> list[Any]:
    """Return the parameters that a form of the command has."""
    return [param for param in command.params if param.name not in HIDDEN]


def is_file(param: Any) -> bool:
    """Return whether a parameter names what is written."""
    return param.name == "out"


def choices(command: TyperCommand, param: Any) -> list[str] | None:
    """Return the values to choose from, with ANY where none need be given; None where any text may be."""
    hint = get_type_hints(command.callback).get(param.name)
    found = next((get_args(part) for part in (hint, *get_args(hint)) if get_origin(part) is Literal), None)
    return None if found is None else [*([ANY] if param.default is None else []), *found]


def default(param: Any, command: str, stem: str) -> str:
    """Return the text that stands in the field at first."""
    if is_file(param):
        return f"{stem}-{command}{Path(str(param.metavar)).suffix}" if param.required else ""
    return "" if param.default is None or callable(param.default) else str(param.default)


def arguments_of(
    command: TyperCommand, folder: Folder, session: str, values: Mapping[str, Any], *, force: bool
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
        elif param.multiple:
            found += [word for part in value.split(",") for word in (option, part.strip())]
        else:
            found += [option, str(folder.new(value)) if is_file(param) else value]
    return [*found, *(["--force"] if force and any(is_file(param) for param in command.params) else [])]
