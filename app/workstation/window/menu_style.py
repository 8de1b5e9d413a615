"""Form: a menu of pygame-menu in the window's look."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pygame
import pygame_menu
from pygame_menu.widgets.selection.highlight import HighlightSelection

from layflat.app.workstation.window import style


def theme() -> pygame_menu.Theme:
    """Return the theme: quiet rows on a card, without a title bar, and a thin frame around the selected one."""
    return pygame_menu.Theme(
        background_color=style.CARD,
        title=False,
        widget_font=style.REGULAR,
        widget_font_size=15,
        widget_font_color=style.TEXT,
        widget_font_antialias=True,
        widget_alignment=pygame_menu.locals.ALIGN_LEFT,
        widget_margin=(14, 5),
        widget_padding=(4, 8),
        widget_offset=(0, 8),
        widget_selection_effect=HighlightSelection(border_width=1, margin_x=2, margin_y=0),
        selection_color=style.ACCENT,
        readonly_color=style.FAINT,
        readonly_selected_color=style.FAINT,
        cursor_color=style.ACCENT,
        cursor_selection_color=(*style.ACCENT, 90),
        scrollbar_color=style.CARD,
        scrollbar_slider_color=style.RAISED,
        scrollbar_slider_hover_color=style.LINE,
        scrollbar_slider_pad=3,
        scrollbar_thick=10,
        widget_cursor=None,
        scrollbar_cursor=None,
        border_width=0,
        focus_background_color=(*style.BACKGROUND, 120),
    )


class Form:
    """A menu that fills an area of the window, one field below another."""

    def __init__(self, area: pygame.Rect, title: str) -> None:
        self._width = area.width
        self.menu = pygame_menu.Menu(
            "",
            area.width,
            area.height,
            theme=theme(),
            position=(area.left, area.top, False),
            center_content=False,
            mouse_motion_selection=True,
            screen_dimension=pygame.display.get_surface().get_size(),
            enabled=True,
        )
        self.menu.add.label(title, font_size=17, font_name=style.BOLD, padding=(6, 8, 2, 8))

    def note(self, text: str) -> None:
        """Add small quiet text, wrapped."""
        lines = "\n".join(style.wrap(text, 13, self._width - 52))
        self.menu.add.label(lines, font_size=13, font_color=style.QUIET, margin=(14, 1), padding=(0, 8))

    def _label(self, name: str) -> None:
        """Add the name of a field above it."""
        self.menu.add.label(name, font_size=12, font_color=style.QUIET, margin=(14, 0), padding=(5, 8, 0, 8))

    def choice(self, name: str, names: Sequence[str], chosen: str, on_change: Callable[[str], None]) -> None:
        """Add a list that drops down."""
        self._label(name)
        self.menu.add.dropselect(
            "",
            [(item, item) for item in names] or [("none", "")],
            default=list(names).index(chosen) if chosen in names else 0,
            onchange=lambda value, _: on_change(value[0][1]),
            placeholder="choose",
            placeholder_add_to_selection_box=False,
            selection_box_width=self._width - 46,
            selection_box_margin=(0, 0),
            selection_box_height=8,
            selection_box_bgcolor=style.RAISED,
            selection_box_border_color=style.LINE,
            selection_box_border_width=1,
            selection_box_arrow_color=style.QUIET,
            selection_option_font=style.REGULAR,
            selection_option_font_size=14,
            selection_option_font_color=style.TEXT,
            selection_option_selected_bgcolor=style.LINE,
            selection_option_selected_font_color=style.TEXT,
            selection_option_border_color=style.RAISED,
            selection_option_border_width=0,
            selection_option_padding=(3, 6),
            selection_infinite=True,
            cursor=None,
            scrollbar_color=style.RAISED,
            scrollbar_slider_color=style.LINE,
            scrollbar_thick=8,
            margin=(14, 0),
            padding=(1, 8),
            font_size=14,
        )

    def entry(self, name: str, value: str, on_change: Callable[[str], None]) -> None:
        """Add a line to write in."""
        self._label(name)

        def change(text: str) -> None:
            self._stretch(widget)
            on_change(str(text).strip())

        widget = self.menu.add.text_input(
            "",
            default=value,
            onchange=change,
            maxwidth=max((self._width - 64) // 9, 8),
            maxwidth_dynamically_update=False,
            font_size=14,
            font_name=style.MONO,
            margin=(14, 0),
            padding=(2, 8),
        )
        widget.set_background_color(style.RAISED, inflate=(0, 0))
        self._stretch(widget)

    def _stretch(self, widget: Any) -> None:
        """Make a line to write in as wide as the form, however short its text."""
        widget.set_padding((2, 8, 2, 8))
        widget.set_padding((2, max(self._width - 46 - widget.get_width() + 16, 8), 2, 8))

    def button(self, text: str, on_press: Callable[[], None], *, main: bool = False) -> None:
        """Add a button; ``main`` is the one that starts something."""
        if main:
            self.menu.add.vertical_margin(8)
        widget = self.menu.add.button(
            text, on_press, margin=(14, 8), padding=(6, 16), font_size=15, font_name=style.BOLD
        )
        widget.set_background_color(style.ACCENT if main else style.RAISED)
        color = style.BACKGROUND if main else style.TEXT
        widget.update_font({"color": color, "selected_color": color})

    def switch(self, name: str, on: bool, on_change: Callable[[bool], None]) -> None:
        """Add a switch."""
        self.menu.add.toggle_switch(
            name,
            on,
            onchange=on_change,
            single_click=True,
            infinite=True,
            state_text=("off", "on"),
            state_color=(style.RAISED, style.ACCENT),
            state_text_font_color=(style.QUIET, style.BACKGROUND),
            state_text_font_size=11,
            slider_color=style.TEXT,
            slider_thickness=10,
            switch_border_width=0,
            switch_height=0.9,
            width=44,
            font_size=14,
            margin=(14, 5),
        )
