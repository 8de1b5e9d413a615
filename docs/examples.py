"""Checks of the documentation's examples, for `make docs` and the tests: Python compiles, command lines parse."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from importlib import import_module
from itertools import pairwise
from typing import Any

from layflat.docs import generated

OTHER_PROGRAMS = {"--filter_key"}
"""Options that pages name in running text and that are not ours."""

CHOOSING = ("--robot", "--task", "--cloth", "--source", "--descriptor", "--controller", "--policy", "--with", "--start")
CHOOSING += ("--engine", "--format", "--mode", "--outcome")
"""Options whose value is one of the names in their help."""

_BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^\1```$", re.M | re.S)
_FENCED = re.compile(r"^ *```.*?^ *```$", re.M | re.S)
_INLINE = re.compile(r"`([^`\n]+)`")


def faults(text: str) -> list[str]:
    """Return what is wrong with the examples of a page."""
    return [*(fault for code in python_blocks(text) for fault in python_faults(code)), *command_faults(text)]


def python_blocks(text: str) -> list[str]:
    """Return the code of each block that is marked as Python."""
    return [match[3] for match in _BLOCK.finditer(text) if match[2] == "python"]


def python_faults(code: str) -> list[str]:
    """Return what is wrong with an example: it does not compile, or names something that Layflat does not have."""
    try:
        tree = ast.parse(code)
    except SyntaxError as error:
        return [f"the example does not compile: {error}"]
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "layflat":
            found += [f"{node.module}.{alias.name}" for alias in node.names if not _has(node.module, alias.name)]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "layflat":
            found += [] if _has("layflat", node.attr) else [f"layflat.{node.attr}"]
    return [f"there is no {name}" for name in found]


def _has(module: str | None, name: str) -> bool:
    try:
        return hasattr(import_module(str(module)), name) or bool(import_module(f"{module}.{name}"))
    except ImportError:
        return False


def command_faults(text: str) -> list[str]:
    """Return what is wrong with the command lines of a page: unknown commands, options, values; missing arguments."""
    known = generated.commands()
    options = {option for command in known.values() for option in _options(command)} | OTHER_PROGRAMS | {"--help"}
    found = []
    for match in _BLOCK.finditer(text):
        for words in _calls(match[3]) if match[2] == "sh" else ():
            found += _parse_faults(words, known)
    for code in _INLINE.findall(_FENCED.sub("", text)):
        words = code.replace("\\|", "|").split()
        if words and words[0] == "layflat" and len(words) > 1:
            found += _mention_faults(words[1:], known)
        elif words and words[0].startswith("--") and not set(words[0].split("=")[0].split("/")) <= options:
            found.append(f"no command has the option {words[0]}")
    return found


def _calls(block: str) -> Iterator[list[str]]:
    """Yield the words behind `layflat` of each call in a block of shell."""
    for line in block.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words and words[0].rsplit("/", 1)[-1] == "layflat":
            yield words[1:]


def _options(command: Any) -> dict[str, Any]:
    return {name: param for param in command.params for name in (*param.opts, *param.secondary_opts)}


def _split(words: list[str], known: dict[str, Any]) -> tuple[Any, list[str]]:
    """Return the command that a call names and the rest of the call; None if there is no such command."""
    for length in (2, 1):
        if " ".join(words[:length]) in known:
            return known[" ".join(words[:length])], words[length:]
    return None, words


def _parse_faults(words: list[str], known: dict[str, Any]) -> list[str]:
    """Return why a whole call does not parse."""
    line = " ".join(("layflat", *words))
    command, rest = _split(words, known)
    if command is None:
        return [f"{line}: there is no such command"]
    try:
        command.make_context(line, list(rest)).close()
    except Exception as error:  # usage errors of the parser, and those of the options' own checks
        return [f"{line}: {error}"]
    return _value_faults(line, command, rest)


def _mention_faults(words: list[str], known: dict[str, Any]) -> list[str]:
    """Return which command, option or choice of a call in running text does not exist."""
    line = " ".join(("layflat", *words))
    command, rest = _split(words, known)
    if command is None:
        members = {name.removeprefix(f"{words[0]} ") for name in known if name.startswith(f"{words[0]} ")}
        fits = members and set("".join(words[1:2]).split("|")) <= members | {""}
        return [] if fits or words == ["--help"] else [f"{line}: there is no such command"]
    options = _options(command)
    found = [f"{line}: no option {word}" for word in rest if word.startswith("--") and word not in options]
    return found or _value_faults(line, command, rest)


def _value_faults(line: str, command: Any, words: list[str]) -> list[str]:
    """Return which values the help of their options does not name; only of options that choose by a name."""
    context = command.make_context("layflat", [], resilient_parsing=True)
    options, found = _options(command), []
    for option, value in pairwise(words):
        if option in CHOOSING and option in options and not (value.isupper() or value.isdigit() or "." in value):
            named = set(re.split(r"[^\w-]+", " ".join(options[option].get_help_record(context))))
            found += [f"{line}: {option} does not name {word}" for word in value.split("|") if word not in named]
    return found
