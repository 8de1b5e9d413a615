"""ControlToken: which of several viewers of a session is in control of it."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field


@dataclass
class ControlToken:
    """Held by at most one viewer; may be used from several threads."""

    holder: str = ""
    """Viewer in control; empty: the first one who acts gets it."""
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def take(self, viewer: str, *, force: bool = False) -> bool:
        """Give control to a viewer; return False where another one has it, unless ``force``."""
        with self._lock:
            if force or self.holder in ("", viewer):
                self.holder = viewer
            return self.holder == viewer

    def release(self, viewer: str) -> None:
        """Give control back, where this viewer has it, such as when it is gone."""
        with self._lock:
            if self.holder == viewer:
                self.holder = ""
