"""Data: the episodes of a session as a table with edits, and everything that `layflat data` does."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from layflat.app.media.thumbnails import thumbnail
from layflat.app.support.errors import UsageError
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.operations import ANY, arguments_of, choices, default, fields
from layflat.app.workstation.web.viewer import Page
from layflat.app.workstation.web.widgets import COLORS, mark, media, output, put, sentence, write
from layflat.data.format.schema import demo_number
from layflat.data.session.editor import SessionEditor
from layflat.data.session.reader import open_session
from layflat.data.tools.episode_index import FLAGS, EpisodeRow, episode_index
from layflat.data.types import OUTCOMES

if TYPE_CHECKING:
    from typer.core import TyperCommand

SORTS: Mapping[str, Callable[[EpisodeRow], Any]] = {
    "number": lambda row: demo_number(row.name),
    "most flags": lambda row: -len(row.flags),
    **{name: attrgetter(name) for name in ("outcome", "contact", "n_steps", "seed", "source")},
    "flat area": lambda row: -1.0 if row.flat_area is None else row.flat_area,
}
THUMBNAIL_PX = 96
PAGE_ROWS = 40
OUTCOME_SIGNS = {"success": "✓", "failure": "✗", "partial": "…"}
NONE = "none"
LOG_LINES = 12
ELSEWHERE = ("edit",)
"""Commands that have parts of their own on the page."""


class DataPage(Page):
    """Page of a session's episodes."""

    name = "Data"

    def build(self) -> None:
        self._rows: Sequence[EpisodeRow] = ()
        self._session = self.session_choice()
        self._media: JobView | None = None
        if self._session:
            self._sort = self.choice("Sort by", list(SORTS), "number", lambda _: self._show())
            self._reverse = self.gui.add_checkbox("Reverse", False)
            self.viewer.on_change(self._reverse, self._show)
            self._first = 0
            self._table = self.gui.add_html("")
            self._turn = self.gui.add_button_group("Rows", ("previous", "next"), visible=False)
            self.viewer.on_click(self._turn, self._turn_page)
            self.gui.add_html(mark("episode"))
            hint = "Click on a row, or write a name such as demo_3."
            self._chosen = self.gui.add_text("Episode", self.viewer.shown_episode, hint=hint)
            self.viewer.on_change(self._chosen, self._choose)
            self._edits = EditForm(self, self._session, self.episode, self._show)
            self.button("Watch", self._watch)
            self.button("Film", lambda: self._make("film.webm", "video", "--episode", _number(self.episode())))
            self.button("Plots of the session", lambda: self._make("plots.png", "plot"))
            self._media = JobView(self.viewer, f"media of {self.viewer.name}")
            self._shown = self.gui.add_html("")
            self._show()
        self._commands()

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
        path, sort, reverse = self.folder.session(self._session), SORTS[str(self._sort.value)], self._reverse.value

        def read() -> tuple[list[EpisodeRow], int, dict[str, bytes], Iterable[str]]:
            with open_session(path) as session:
                rows = sorted(episode_index(session), key=sort, reverse=bool(reverse))
                first = min(self._first, max(len(rows) - 1, 0) // PAGE_ROWS * PAGE_ROWS)
                shown = [row.name for row in rows[first : first + PAGE_ROWS]]
                pictures = {name: thumbnail(session, name, width=THUMBNAIL_PX) for name in shown}
                return rows, first, pictures, session.dropped

        def done(found: tuple[list[EpisodeRow], int, dict[str, bytes], Iterable[str]]) -> None:
            self._rows, self._first, self._pictures, dropped = found
            put(self._turn, visible=len(self._rows) > PAGE_ROWS)
            self._edits.show(dropped)
            self._draw()

        self.viewer.background(read, done)

    def _draw(self) -> None:
        rows = self._rows[self._first : self._first + PAGE_ROWS]
        put(self._table, content=episode_table(rows, self._pictures, self.episode()))

    def _turn_page(self) -> None:
        self._first = max(self._first + (PAGE_ROWS if self._turn.value == "next" else -PAGE_ROWS), 0)
        self._show()

    def _watch(self) -> None:
        self.viewer.shown_session, self.viewer.shown_episode = self._session, self.episode()
        self.viewer.open("Replay")

    def _make(self, name: str, command: str, *options: str) -> None:
        """Make a film or a plot beside the folder; it is shown when it is done."""
        assert self._media is not None
        made = self.workstation.scratch / f"{self.viewer.client.client_id}-{name}"
        put(self._shown, content="")
        path = str(self.folder.session(self._session))
        self._media.start(["data", command, path, *options, "--out", str(made), "--force"])

    def update(self) -> None:
        """Show the commands in the background, and what they have made."""
        if self._media is not None and self._media.update() and self._media.succeeded and self._media.job is not None:
            made = Path(self._media.job.arguments[-2])
            kind = "video/webm" if made.suffix == ".webm" else "image/png"
            put(self._shown, content=media(made.read_bytes(), kind, f"Plots of {self._session}"))
        if self._job.update():
            self.viewer.rebuild()

    # Commands

    def _commands(self) -> None:
        """Add a form of every `layflat data` command."""
        self._fields: dict[str, Any] = {}
        commands = [name for name in self.workstation.commands if name not in ELSEWHERE]
        with self.gui.add_folder("Commands", expand_by_default=False):
            offered = commands if self._session else [name for name in commands if name == "import"]
            self._operation = self.choice("Command", offered or [""], change=lambda _: self._show_fields())
            self._about = self.gui.add_html("")
            self._options = self.gui.add_folder("Options")
            self._force = self.gui.add_checkbox("Replace if it exists", False)
            self.button("Run", self._run, control=True)
            self._job = JobView(self.viewer, "data")
        if offered:
            self._show_fields()

    def _command(self) -> TyperCommand:
        return self.workstation.commands[str(self._operation.value)]

    def _show_fields(self) -> None:
        for handle in self._fields.values():
            handle.remove()
        put(self._about, content=sentence(str(self._command().help).partition("\n")[0]))
        with self._options:
            self._fields = {str(param.name): self._add_field(param) for param in fields(self._command())}
            if self._operation.value == "import":
                self._fields["path"] = self.choice("File", self.folder.foreign() or [""])

    def _add_field(self, param: Any) -> Any:
        label, hint = str(param.name).replace("_", " ").capitalize(), getattr(param, "help", None)
        options = choices(self._command(), param)
        if param.name == "paths":
            label, options = "With", [ANY, *(name for name in self.folder.sessions() if name != self._session)]
        elif param.name == "episode":
            options = [*([] if param.required else [ANY]), *self.episode_names(self._session)]
        if options is not None:
            return self.choice(label, options or [""], str(param.default), hint=hint)
        if param.is_flag:
            return self.gui.add_checkbox(label, bool(param.default), hint=hint)
        stem = self._session.rpartition(".")[0] or "data"
        return self.gui.add_text(label, default(param, str(self._operation.value), stem), hint=hint)

    def _run(self) -> None:
        values = {name: handle.value for name, handle in self._fields.items()}
        source = str(values.pop("path", self._session))
        if source not in (*self.folder.sessions(), *self.folder.foreign()):
            source = self.folder.session(source).name
        force = bool(self._force.value)
        self._job.start(arguments_of(self._command(), self.folder, source, values, force=force))


def _number(episode: str) -> str:
    return str(demo_number(episode))


def episode_table(rows: Sequence[EpisodeRow], pictures: Mapping[str, bytes], chosen: str) -> str:
    """Return episodes as an HTML table whose rows can be clicked, and reached with the Tab key."""
    if not rows:
        return sentence("There are no episodes in this session.")
    lines, size = [], f'width="{THUMBNAIL_PX}" height="{THUMBNAIL_PX * 3 // 4}"'
    click = html.escape(write("episode", "this.dataset.name"))
    for row in rows:
        data = base64.b64encode(pictures.get(row.name, b"")).decode()
        image = f'<img alt="" {size} src="data:image/png;base64,{data}">' if data else ""
        flags = "".join(f'<div title="{html.escape(FLAGS[flag])}">⚑ {html.escape(flag)}</div>' for flag in row.flags)
        flat = "" if row.flat_area is None else f", flat {row.flat_area:.2f}"
        note = f"<div><i>{html.escape(row.note)}</i></div>" if row.note else ""
        ground = "background:rgba(15,118,110,.16);" if row.name == chosen else ""
        lines.append(
            f'<tr tabindex="0" role="button" data-name="{row.name}" onclick="{click}"'
            f' onkeydown="if(event.key===\'Enter\')this.click()" style="cursor:pointer;{ground}">'
            f'<td style="width:1%;padding-right:0.6em">{image}</td>'
            f"<td><b>{row.name}</b> {OUTCOME_SIGNS[row.outcome]} {row.outcome}"
            f"<div>contact {100 * row.contact:.0f} %{flat}</div>"
            f'<div style="opacity:.75">{row.length_s:.1f} s, {html.escape(row.source)}, seed {row.seed}</div>'
            f'{note}<div style="color:{COLORS["warning"]}">{flags}</div></td></tr>'
        )
    style = "font-size:0.8em;max-height:24em;overflow:auto;margin:0 0.6em"
    return f'<div style="{style}"><table style="width:100%;border-spacing:0 0.3em">{"".join(lines)}</table></div>'


class EditForm:
    """Edits of the chosen episode; each is durable at once and can be undone."""

    def __init__(self, page: Page, session: str, chosen: Callable[[], str], changed: Callable[[], None]) -> None:
        """``chosen`` returns the episode's name; ``changed`` is called after each edit."""
        self._page = page
        self._session = session
        self._chosen = chosen
        self._changed = changed
        gui = page.gui
        with gui.add_folder("Edit", visible=not page.folder.read_only):
            label = gui.add_button_group("Label as", OUTCOMES)
            relabel = lambda: self._edit(lambda editor: editor.relabel(self._episode(), str(label.value)))  # noqa: E731
            page.viewer.on_click(label, relabel, control=True)
            self._note = gui.add_text("Note", "")
            self._button("Keep the note", lambda editor: editor.note(self._episode(), self._note.value))
            self._keep = gui.add_vector2("Keep steps", (0, 0), min=(0, 0), step=1)
            self._button("Trim", lambda editor: editor.trim(self._episode(), *(int(end) for end in self._keep.value)))
            self._button("Drop", lambda editor: editor.drop(self._episode()))
            self._dropped = gui.add_dropdown("Dropped", (NONE,), initial_value=NONE)
            self._button("Restore", lambda editor: editor.restore(str(self._dropped.value)))
            self._button("Undo the last edit", lambda editor: editor.undo())
            self._log = gui.add_html("")

    def _button(self, label: str, edit: Callable[[SessionEditor], object]) -> None:
        self._page.button(label, lambda: self._edit(edit), control=True)

    def _episode(self) -> str:
        if not self._chosen():
            raise UsageError("no episode is chosen; click on one")
        return self._chosen()

    def _edit(self, edit: Callable[[SessionEditor], object]) -> None:
        editor = SessionEditor(self._page.folder.session(self._session))
        edit(editor)
        self._page.viewer.say(f"{editor.log().edits[-1].text}: done; Undo takes it back", "success")
        self._changed()

    def choose(self, row: EpisodeRow) -> None:
        """Show note and length of an episode."""
        put(self._note, value=row.note)
        put(self._keep, value=(0.0, float(row.n_steps)))

    def show(self, dropped: Iterable[str]) -> None:
        """Show the newest edits, and what has been dropped."""
        log = SessionEditor(self._page.folder.session(self._session)).log()
        undone = log.undone()
        lines = [
            f"{edit.number} {edit.when_utc[:16].replace('T', ' ')} {edit.who}: {edit.text}"
            + (" (undone)" if edit.number in undone else "")
            for edit in reversed(log.edits[-LOG_LINES:])
        ]
        put(self._log, content=output(lines))
        put(self._dropped, options=(NONE, *dropped))
