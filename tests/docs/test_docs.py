"""The documentation: links, anchors and pictures exist, examples hold, and the command line's page is complete."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from layflat.app.cli.main import cli
from layflat.data.format import schema
from layflat.docs import examples, generated
from layflat.sim.conditions.keys import keys
from layflat.sim.conditions.variation import shipped

ROOT = generated.ROOT
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]
OLD_WORDS = re.compile(
    r"\b(befall\w*|befell|anew|whoever|whatever|nobody|forth|told|has not got|goes on|is to be)\b", re.I
)


def without_code(text: str) -> str:
    """Return a page without its blocks of code."""
    return re.sub(r"^ *```.*?^ *```$", "", text, flags=re.M | re.S)


def anchors(path: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and MyST make them."""
    name = path.relative_to(ROOT / "docs").with_suffix("").as_posix() if "docs" in path.parts else ""
    text = without_code(generated.page(name, path.read_text(encoding="utf-8")))
    titles = [title.replace("`", "") for title in re.findall(r"^#+ (.*)$", text, re.M)]
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("name", NAMES)
def test_links_anchors_and_pictures_exist(name: str) -> None:
    page = ROOT / name
    for target in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text(encoding="utf-8"))):
        if re.match(r"https?://", target):
            continue
        file, _, anchor = target.partition("#")
        path = (page.parent / file).resolve() if file else page
        assert path.is_file(), f"{name} links {target}"
        assert not anchor or anchor in anchors(path), f"{name} links {target}"


def test_pages_named_in_the_code_exist() -> None:
    code = [path for folder in (*generated.PACKAGES, "app", "tests") for path in (ROOT / folder).rglob("*.py")]
    named = {name for path in code for name in re.findall(r"docs/[\w/-]+\.md", path.read_text(encoding="utf-8"))}
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []


def test_every_picture_is_shown() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    unused = [path.name for path in (ROOT / "docs/images").iterdir() if f"images/{path.name}" not in text]
    assert unused == []


def test_named_tests_exist() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    named = {*re.findall(r"\btest_\w+", text), *(f"test_{name}" for name in re.findall(r"-k (\w+)", text))}
    assert named <= {path.stem for path in (ROOT / "tests").rglob("test_*.py")}


def dead_references(text: str) -> list[str]:
    """Return modules that cannot be run, targets of make, and files in backticks that do not exist."""
    modules = re.findall(r"python3? -m (layflat(?:\.\w+)+)", text)
    files = [ROOT.joinpath(*module.split(".")[1:]) for module in modules]
    runs = [(path / "__main__.py").is_file() or '"__main__"' in _text(path.with_suffix(".py")) for path in files]
    targets = set(re.findall(r"^([\w-]+):", _text(ROOT / "Makefile"), re.M))
    made = re.findall(r"`(?:\w+=\S+ )*make ([a-z][\w-]*)", text)
    paths = re.findall(r"`((?:app|data|docs|perception|policy|sim|tests)/[\w./-]+)`", text)
    return [
        *(module for module, run in zip(modules, runs, strict=True) if not run),
        *(target for target in made if target not in targets),
        *(path for path in paths if not (ROOT / path).exists()),
    ]


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def test_modules_targets_and_files_that_are_named_exist() -> None:
    pages = [page for page in (*PAGES, *ROOT.glob("*.md")) if page.name != "CHANGELOG.md"]
    code = [path for folder in (*generated.PACKAGES, "app", "docs", "tests") for path in (ROOT / folder).rglob("*.py")]
    texts = {path: _text(path) for path in (*pages, *code) if path != Path(__file__)}
    assert {str(path.relative_to(ROOT)): dead_references(text) for path, text in texts.items()} == {
        str(path.relative_to(ROOT)): [] for path in texts
    }


@pytest.mark.parametrize(
    "wrong",
    ["python -m layflat.tests.no_such_module FOLDER", "`python -m layflat.data.types`", "`make no-such-target`",
     "in `app/workstation/window/no_such.py`"],
)  # fmt: skip
def test_dead_references_are_found(wrong: str) -> None:
    assert len(dead_references(wrong)) == 1


@pytest.mark.parametrize("name", [name for name in NAMES if name != "CHANGELOG.md"])
def test_examples_compile_and_command_lines_parse(name: str) -> None:
    assert examples.faults((ROOT / name).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "wrong",
    [
        "```sh\nlayflat recrod demos.h5\n```",
        "```sh\nlayflat record demos.h5 --robots hanger\n```",
        "```sh\nlayflat record demos.h5 --robot lifter\n```",
        "```sh\nlayflat train demos.h5\n```",
        "Use `layflat place word.npz --films`.",
        "Use `layflat data mend FILE.h5`.",
        "Use `layflat record F.h5 --source joystick`.",
        "Give `--no-such-option`.",
        "```python\nimport layflat\nlayflat.no_such_name()\n```",
        "```python\nfrom layflat.data import no_such_name\n```",
        "```python\nprint(\n```",
    ],
)
def test_wrong_examples_are_found(wrong: str) -> None:
    assert len(examples.faults(wrong)) == 1


def test_the_page_of_the_command_line_is_complete() -> None:
    groups = {group.typer_instance.info.name: group.typer_instance for group in cli.registered_groups}
    expected = {(c.name or c.callback.__name__) for c in cli.registered_commands if c.callback}
    expected |= {f"{name} {c.name or c.callback.__name__}" for name, g in groups.items() for c in g.registered_commands}
    page = generated.cli_page("")
    assert set(re.findall(r"^## layflat (.*)$", page, re.M)) == expected
    sections = dict(zip(*[iter(re.split(r"^## layflat (.*)$", page, flags=re.M)[1:])] * 2, strict=True))
    for name, command in generated.commands().items():
        for param in command.params:
            for option in (*param.opts, *param.secondary_opts) if param.param_type_name == "option" else ():
                assert option in sections[name], f"{name} {option}"


def test_the_page_of_the_session_file_lists_every_data_set() -> None:
    text = (ROOT / "docs/reference/session-file.md").read_text(encoding="utf-8").split("## Attributes")[0]
    listed = set(re.findall(r"^\| `([^`]+)` \| \(", text, re.M))
    assert listed == {re.sub(r"^(next_)?obs/", "", key) for key in schema.FIELDS}


def test_the_page_of_conditions_lists_every_key_and_the_guide_every_variation() -> None:
    listed = re.findall(r"^\| `(\w+)` \|", generated.conditions_page(""), re.M)
    assert listed == [*keys()]
    guide = (ROOT / "docs/how-to/conditions.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| `(\w+)` \|", guide, re.M)) == list(shipped())


def test_the_readme_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = examples.python_blocks((ROOT / "README.md").read_text(encoding="utf-8"))
    names: dict[str, object] = {}
    exec(compile(code, "README.md", "exec"), names)  # noqa: S102  # our own file
    assert names["episode"].contact_final > 0.9  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", NAMES)
def test_lines_are_short_and_words_are_plain(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    assert [line for line in text.splitlines() if len(line) > 120] == []
    assert OLD_WORDS.findall(text) == []
