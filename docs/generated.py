"""Pages of the documentation that are made from the project: home, changelog, command line, packages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data", "perception", "policy", "sim")
CONTENTS = {
    "": "tutorial",
    "How-to guides": """
        how-to/index how-to/record how-to/workstation how-to/train how-to/place how-to/evaluate how-to/suites
        how-to/conditions how-to/benchmark how-to/cluster how-to/sessions how-to/mend how-to/export how-to/camera
        how-to/own-policy how-to/own-cloth how-to/station how-to/python""",
    "Reference": """
        reference/index reference/cli reference/python reference/api/index reference/names reference/conditions
        reference/observations reference/controls reference/browser-view
        reference/session-file reference/station-file reference/files changelog""",
    "Explanation": """
        explanation/index explanation/architecture explanation/word explanation/seeing explanation/contact
        explanation/policies explanation/simulation explanation/pybullet explanation/durability""",
    "Results": """
        explanation/results/thesis explanation/results/policies explanation/results/wrinkle-removal
        explanation/results/word explanation/results/contact explanation/results/camera explanation/results/cloths
        explanation/results/disturbances explanation/results/benchmark explanation/results/engines
        explanation/results/two-arms explanation/results/station
        explanation/results/speed""",
}
"""Pages of each part, in the order of the site's table of contents."""


def page(name: str, written: str) -> str:
    """Return the text of a page: made from the project where it stands in PAGES, else as it was written."""
    return PAGES[name](written) if name in PAGES else written


def from_root(file: str) -> Callable[[str], str]:
    """Return the maker of a page that shows a file of the project's root, with its links as the site needs them."""

    def make(written: str) -> str:
        text = (ROOT / file).read_text(encoding="utf-8").replace("](docs/", "](")
        return re.sub(r"\[([^\]]+)\]\(LICENSE\)", r"\1", text.replace("](CHANGELOG.md", "](changelog.md"))

    return make


def home_page(written: str) -> str:
    """Return README.md with the site's table of contents."""
    contents = [
        "\n".join(["```{toctree}", ":hidden:", *([f":caption: {part}"] if part else []), "", *pages.split(), "```"])
        for part, pages in CONTENTS.items()
    ]
    return "\n\n".join([from_root("README.md")(written), *contents]) + "\n"


def package_page(package: str) -> Callable[[str], str]:
    """Return the maker of a package's page: each module with its documented classes and functions."""

    def make(written: str) -> str:
        lines = [f"# layflat.{package}", ""]
        for path in sorted((ROOT / package).rglob("*.py")):
            if path.name != "__init__.py":
                module = ".".join(("layflat", *path.relative_to(ROOT).with_suffix("").parts))
                lines += [f"## {module}", "", "```{eval-rst}", f".. automodule:: {module}", "   :members:", "```", ""]
        return "\n".join(lines)

    return make


def commands() -> dict[str, Any]:
    """Return every command of `layflat` by its full name, such as "data info", without the groups."""
    import typer

    from layflat.app.cli.main import cli

    def leaves(command: Any, name: str) -> Iterator[tuple[str, Any]]:
        if not hasattr(command, "commands"):
            yield name, command
        for sub_name, sub in getattr(command, "commands", {}).items():
            yield from leaves(sub, f"{name} {sub_name}".strip())

    return dict(leaves(typer.main.get_command(cli), ""))


def cli_page(written: str) -> str:
    """Return the reference of the command line, made from the typer application."""
    made = commands()
    lines = [
        "# Command line",
        "",
        "Progress goes to stderr, results to stdout. Exit status: 0 done, 1 the work failed, 2 the call or the input",
        "is wrong, 130 interrupted (finished episodes are kept). Closing the live window of `record`, by its X, a key,",
        "Ctrl-C or SIGTERM, is its normal end: 0. So is Ctrl-C for the server of `app`; in a terminal and in batch",
        "commands Ctrl-C gives 130. A file that exists is replaced only with `--force`; `record` appends. `--debug`",
        "prints the traceback of a failure.",
        "",
        "| command | does |",
        "|---|---|",
    ]
    for name, command in made.items():
        lines.append(f"| [`layflat {name}`](#layflat-{name.replace(' ', '-')}) | {_paragraphs(command)[0]} |")
    for name, command in made.items():
        lines += ["", f"## layflat {name}", *_section(name, command)]
    return "\n".join(lines) + "\n"


def conditions_page(written: str) -> str:
    """Return the reference of the keys of `--set`, made from their table."""
    from layflat.app.commands.config import HEADER, cells
    from layflat.sim.conditions.keys import keys

    lines = [
        "# Conditions",
        "",
        "Keys of `--set KEY=VALUE`, of the arguments of `layflat.make_env` and the Gymnasium environments, of",
        "`sim_config` in a session, and of variations; see [Set and vary conditions](../how-to/conditions.md).",
        "",
        f"| {' | '.join(HEADER)} |",
        "|---" * len(HEADER) + "|",
    ]
    lines += ["| " + " | ".join((f"`{name}`", *rest)) + " |" for name, *rest in map(cells, keys().values())]
    return "\n".join(lines) + "\n"


def _paragraphs(command: Any) -> list[str]:
    return [" ".join(part.split()) for part in (command.help or "").strip().split("\n\n")]


def _section(name: str, command: Any) -> Iterator[str]:
    context = command.make_context(f"layflat {name}", [], resilient_parsing=True)
    for paragraph in _paragraphs(command):
        yield from ("", paragraph)
    yield from ("", "```text", " ".join(command.get_usage(context).removeprefix("Usage: ").split()), "```", "")
    yield from ("| argument or option | meaning | default |", "|---|---|---|")
    for param in command.params:
        record = None if getattr(param, "hidden", False) else param.get_help_record(context)
        if record:
            yield _row(*record)


def _row(left: str, text: str) -> str:
    """Return a table's row of a parameter; the default stands at the end of its help in brackets."""
    notes = re.findall(r"\[((?:default: |required|x).*?)\]", text)
    meaning = re.sub(r"\s*\[(?:default: |required|x).*?\]", "", text)
    cells = (f"`{left}`", meaning, ", ".join(note.removeprefix("default: ").strip("()") for note in notes))
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


PAGES: dict[str, Callable[[str], str]] = {
    "index": home_page,
    "changelog": from_root("CHANGELOG.md"),
    "reference/cli": cli_page,
    "reference/conditions": conditions_page,
    **{f"reference/api/{package}": package_page(package) for package in PACKAGES},
}
"""Makers of the pages whose files in docs/ only hold their place."""
