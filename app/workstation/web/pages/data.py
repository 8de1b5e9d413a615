"""Data: the episodes of a session as a table, and everything that `layflat data` does with them."""

from __future__ import annotations

from layflat.app.workstation.web.pages.page import Page


class DataPage(Page):
    """Page of a session's episodes."""

    name = "Data"
