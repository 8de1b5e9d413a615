"""pygame-menu in the window's own look."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pygame
import pygame_menu
from pygame_menu.widgets.selection.highlight import HighlightSelection

from layflat.app.workstation.window import style

ROW_PX = 15
"""Size of a menu's letters."""


def theme() -> pygame_menu.Theme:
    """Quiet rows on a card, without a title bar; the row that has the keyboard has a thin frame."""
    return pygame_menu.Theme(
        background_color=style.CARD,
        title=False,
        widget_font=style.REGULAR,
        widget_font_size=ROW_PX,
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
        focus_background_color=(*style.GROUND, 120),
    )


def menu(area: pygame.Rect) -> pygame_menu.Menu:
    """An empty menu that fills ``area`` of the window."""
    return pygame_menu.Menu(
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


def heading(into: pygame_menu.Menu, text: str) -> None:
    into.add.label(text, font_size=17, font_name=style.BOLD, padding=(6, 8, 2, 8))


def note(into: pygame_menu.Menu, text: str, width: int) -> Any:
    """Small quiet text, wrapped."""
    lines = "\n".join(style.wrapped(text, 13, width - 52))
    return into.add.label(lines, font_size=13, font_color=style.QUIET, margin=(14, 1), padding=(0, 8))


def _named(into: pygame_menu.Menu, name: str) -> None:
    """What a field is called, above it."""
    into.add.label(name, font_size=12, font_color=style.QUIET, margin=(14, 0), padding=(5, 8, 0, 8))


def choice(
    into: pygame_menu.Menu,
    name: str,
    known: list[str],
    chosen: str,
    on_change: Callable[[str], None],
    *,
    width: int,
) -> Any:
    """One of a few, or of a list that drops down."""
    _named(into, name)
    items = [(item, item) for item in known] or [("none", "")]
    default = known.index(chosen) if chosen in known else 0
    return into.add.dropselect(
        "",
        items,
        default=default,
        onchange=lambda value, _: on_change(value[0][1]),
        placeholder="choose",
        placeholder_add_to_selection_box=False,
        selection_box_width=width - 46,
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


def entry(
    into: pygame_menu.Menu,
    name: str,
    value: str,
    on_change: Callable[[str], None],
    *,
    width: int,
    numbers: bool = False,
) -> Any:
    """A line to write in."""
    _named(into, name)

    def changed(text: str) -> None:
        _stretch(widget, width)
        on_change(str(text))

    widget = into.add.text_input(
        "",
        default=value,
        onchange=changed,
        input_type=pygame_menu.locals.INPUT_INT if numbers else pygame_menu.locals.INPUT_TEXT,
        maxwidth=max((width - 64) // 9, 8),
        maxwidth_dynamically_update=False,
        font_size=14,
        font_name=style.MONO,
        margin=(14, 0),
        padding=(2, 8),
    )
    widget.set_background_color(style.RAISED, inflate=(0, 0))
    _stretch(widget, width)
    return widget


def _stretch(widget: Any, width: int) -> None:
    """A line to write in is as wide as its menu, however little is written."""
    widget.set_padding((2, 8, 2, 8))
    widget.set_padding((2, max(width - 46 - widget.get_width() + 16, 8), 2, 8))


def button(into: pygame_menu.Menu, text: str, on_press: Callable[[], None], *, main: bool = False) -> Any:
    if main:
        into.add.vertical_margin(8)
    widget = into.add.button(text, on_press, margin=(14, 8), padding=(6, 16), font_size=15, font_name=style.BOLD)
    widget.set_background_color(style.ACCENT if main else style.RAISED)
    widget.update_font(
        {"color": style.GROUND if main else style.TEXT, "selected_color": style.GROUND if main else style.TEXT}
    )
    return widget


def switch(into: pygame_menu.Menu, name: str, on: bool, on_change: Callable[[bool], None]) -> Any:
    """Yes or no."""
    return into.add.toggle_switch(
        name,
        on,
        onchange=on_change,
        single_click=True,
        infinite=True,
        state_text=("off", "on"),
        state_color=(style.RAISED, style.ACCENT),
        state_text_font_color=(style.QUIET, style.GROUND),
        state_text_font_size=11,
        slider_color=style.TEXT,
        slider_thickness=10,
        switch_border_width=0,
        switch_height=0.9,
        width=44,
        font_size=14,
        margin=(14, 5),
    )
