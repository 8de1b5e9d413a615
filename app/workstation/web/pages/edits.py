"""EditForm: relabel, note, trim, drop and restore an episode, and take edits back."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from layflat.app.support.errors import UsageError
from layflat.app.workstation.web.viewer import Page
from layflat.app.workstation.web.widgets import output, put
from layflat.data.session.editor import SessionEditor
from layflat.data.tools.episode_index import EpisodeRow
from layflat.data.types import OUTCOMES

NONE = "none"
LOG_LINES = 12


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
