"""Data: the episodes of a session as a table with edits, and everything that `layflat data` does."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any

from layflat.app.media.thumbnails import thumbnail
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.operations import ANY, FORMATS, OPERATIONS, Field, arguments_of
from layflat.app.workstation.web.pages.edits import EditForm
from layflat.app.workstation.web.pages.page import Page
from layflat.app.workstation.web.widgets import film, picture, put, sentence
from layflat.data.format.schema import demo_number
from layflat.data.session.reader import open_session
from layflat.data.tools.episode_index import FLAGS, EpisodeRow, episode_index
from layflat.data.types import OUTCOMES

SORTS: Mapping[str, Callable[[EpisodeRow], Any]] = {
    "number": lambda row: demo_number(row.name),
    "most flags": lambda row: -len(row.flags),
    **{name: attrgetter(name) for name in ("outcome", "contact", "n_steps", "seed", "source")},
    "flat area": lambda row: -1.0 if row.flat_area is None else row.flat_area,
}
THUMBNAIL_PX = 96
PAGE_ROWS = 40
OUTCOME_SIGNS = {"success": "✓", "failure": "✗", "partial": "…"}
CHOOSE = (
    "const f=document.querySelector('div:has(> .lf-episode) + div input');"
    "Object.getOwnPropertyDescriptor(HTMLInputElement.prototype,'value').set.call(f,this.dataset.name);"
    "f.dispatchEvent(new Event('input',{bubbles:true}))"
)
"""A click on a row writes its name into the field below, as typing would."""


class DataPage(Page):
    """Page of a session's episodes."""

    name = "Data"

    def build(self) -> None:
        """Add the page's parts."""
        self._session = self.session_choice(self.viewer.shown_session, self._choose_session)
        self._media = None
        if self._session:
            self._sort = self.choice("Sort by", list(SORTS), "number", lambda _: self._show())
            self._reverse = self.gui.add_checkbox("Reverse", False)
            self.viewer.on_change(self._reverse, self._show)
            self._first = 0
            self._table = self.gui.add_html("")
            self._turn = self.gui.add_button_group("Rows", ("previous", "next"), visible=False)
            self.viewer.on_click(self._turn, self._turn_page)
            self.gui.add_html('<span class="lf-episode"></span>')
            self._chosen = self.gui.add_text(
                "Episode", self.viewer.shown_episode, hint="Click on a row, or write a name such as demo_3."
            )
            self.viewer.on_change(self._chosen, self._choose)
            self._edits = EditForm(self.viewer, self.folder, self._session, self.episode, self._show)
            self.button("Watch", lambda: self._watch())
            self.button("Film", self._film)
            self.button("Plots of the session", self._plot)
            self._media = JobView(self.viewer, f"media of {self.viewer.name}")
            self._shown = self.gui.add_html("")
        self._commands()
        if self._session:
            self._show()

    def _choose_session(self, name: str) -> None:
        self.viewer.shown_session, self.viewer.shown_episode = name, ""
        self.viewer.rebuild()

    def episode(self) -> str:
        """Return the chosen episode's name."""
        return str(self._chosen.value).strip()

    def _choose(self) -> None:
        self.viewer.shown_episode = self.episode()
        row = next((row for row in self._rows if row.name == self.episode()), None)
        if row is not None:
            self._edits.choose(row)
            self._draw()

    def _show(self) -> None:
        """Read the session again, and show its episodes."""
        with open_session(self.folder.session(self._session)) as session:
            rows = sorted(episode_index(session), key=SORTS[str(self._sort.value)], reverse=bool(self._reverse.value))
            self._rows = rows
            self._first = min(self._first, max(len(rows) - 1, 0) // PAGE_ROWS * PAGE_ROWS)
            shown = rows[self._first : self._first + PAGE_ROWS]
            dropped = session.dropped
            self._pictures = {row.name: thumbnail(session, row.name, width=THUMBNAIL_PX) for row in shown}
        put(self._turn, visible=len(rows) > PAGE_ROWS)
        self._edits.show(dropped)
        self._draw()

    def _draw(self) -> None:
        rows = self._rows[self._first : self._first + PAGE_ROWS]
        put(self._table, content=episode_table(rows, self._pictures, self.episode()))

    def _turn_page(self) -> None:
        self._first = max(self._first + (PAGE_ROWS if self._turn.value == "next" else -PAGE_ROWS), 0)
        self._show()

    def _watch(self) -> None:
        self.viewer.shown_session, self.viewer.shown_episode = self._session, self.episode()
        self.viewer.open("Replay")

    def _film(self) -> None:
        number = str(demo_number(self.episode()))
        self._start("film.webm", ["video", str(self.folder.session(self._session)), "--episode", number])

    def _plot(self) -> None:
        self._start("plots.png", ["plot", str(self.folder.session(self._session))])

    def _start(self, name: str, arguments: list[str]) -> None:
        """Make a film or a plot beside the folder, and show it when it is done."""
        assert self._media is not None
        self._made = self.workstation.scratch / f"{self.viewer.client.client_id}-{name}"
        put(self._shown, content="")
        self._media.start(["data", *arguments, "--out", str(self._made), "--force"])

    def update(self) -> None:
        """Show the commands in the background, and what they have made."""
        if self._media is not None and self._media.update() and self._media.succeeded:
            made = self._made.read_bytes()
            shown = film(made) if self._made.suffix == ".webm" else picture(made, alt=f"Plots of {self._session}")
            put(self._shown, content=shown)
        if self._job.update():
            self.viewer.rebuild()

    # Commands

    def _commands(self) -> None:
        """Add a form of every `layflat data` command."""
        with self.gui.add_folder("Commands", expand_by_default=False):
            operations = list(OPERATIONS) if self._session else ["import"]
            self._operation = self.choice("Command", operations, operations[0], lambda _: self._show_fields())
            self._fields_folder = self.gui.add_folder("Options")
            self._force = self.gui.add_checkbox("Replace if it exists", False)
            self.button("Run", self._run, control=True)
            self._job = JobView(self.viewer, "data")
        self._fields: dict[str, Any] = {}
        self._show_fields()

    def _show_fields(self) -> None:
        for handle in self._fields.values():
            handle.remove()
        with self._fields_folder:
            self._fields = {item.name: self._add_field(item) for item in OPERATIONS[str(self._operation.value)]}
            if self._operation.value == "import":
                names = self.folder.foreign() or [""]
                self._fields["file"] = self.gui.add_dropdown("File", tuple(names), initial_value=names[0])

    def _add_field(self, item: Field) -> Any:
        stem, operation = self._session.rsplit(".", 1)[0], str(self._operation.value)
        default = item.default.replace("{op}", operation).replace("{}", stem or "data")
        choices: Mapping[str, Callable[[], list[str]]] = {
            "episode": lambda: self.episode_names(self._session), "outcome": lambda: [ANY, *OUTCOMES],
            "format": lambda: list(FORMATS), "switch": lambda: ["on", "off"],
            "session": lambda: [name for name in self.folder.sessions() if name != self._session],
        }  # fmt: skip
        if item.kind not in choices:
            return self.gui.add_text(item.label, default)
        options = choices[item.kind]() or [""]
        return self.gui.add_dropdown(item.label, tuple(options), initial_value=options[0])

    def _run(self) -> None:
        operation = str(self._operation.value)
        values = {name: str(handle.value) for name, handle in self._fields.items()}
        source = values.get("file", self._session)
        if source not in (*self.folder.sessions(), *self.folder.foreign()):
            source = self.folder.session(source).name
        self._job.start(arguments_of(operation, self.folder, source, values, force=bool(self._force.value)))


def episode_table(rows: list[EpisodeRow], pictures: Mapping[str, bytes], chosen: str) -> str:
    """Return episodes as an HTML table whose rows can be clicked, and reached with the Tab key."""
    if not rows:
        return sentence("There are no episodes in this session.")
    lines = []
    for row in rows:
        data = base64.b64encode(pictures.get(row.name, b"")).decode()
        image = (
            f'<img alt="" width="{THUMBNAIL_PX}" height="{THUMBNAIL_PX * 3 // 4}" src="data:image/png;base64,{data}">'
            if data
            else ""
        )
        flags = "".join(f'<div title="{html.escape(FLAGS[flag])}">⚑ {html.escape(flag)}</div>' for flag in row.flags)
        flat = "" if row.flat_area is None else f", flat {row.flat_area:.2f}"
        note = f"<div><i>{html.escape(row.note)}</i></div>" if row.note else ""
        ground = "background:rgba(15,118,110,.16);" if row.name == chosen else ""
        lines.append(
            f'<tr tabindex="0" role="button" data-name="{row.name}" onclick="{CHOOSE}"'
            f' onkeydown="if(event.key===\'Enter\')this.click()" style="cursor:pointer;{ground}">'
            f'<td style="width:1%;padding-right:0.6em">{image}</td>'
            f"<td><b>{row.name}</b> {OUTCOME_SIGNS[row.outcome]} {row.outcome}"
            f"<div>contact {100 * row.contact:.0f} %{flat}</div>"
            f'<div style="opacity:.75">{row.length_s:.1f} s, {html.escape(row.source)}, seed {row.seed}</div>'
            f'{note}<div style="color:#b45309">{flags}</div></td></tr>'
        )
    style = "font-size:0.8em;max-height:24em;overflow:auto;margin:0 0.6em"
    return f'<div style="{style}"><table style="width:100%;border-spacing:0 0.3em">{"".join(lines)}</table></div>'
