"""Ghost: the cloth of the best demonstration of a session, beside the one that is being laid."""

from __future__ import annotations

from pathlib import Path

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.data.arrays import FloatArray
from layflat.data.errors import DataError
from layflat.data.session.reader import open_session


class Ghost:
    """Nodes of the success with the highest contact at the step of the newest frame."""

    def __init__(self, session: Path | None) -> None:
        self.on = False
        self.nodes: FloatArray | None = None
        """Nodes (N, 3) m that are shown now, or None."""
        self._steps: list[FloatArray] = [] if session is None or not session.exists() else _best(session)

    @property
    def available(self) -> bool:
        """Whether the session has a demonstration to show."""
        return bool(self._steps)

    @property
    def state(self) -> str:
        """Whether it is shown, for a person."""
        return "shown" if self.on else "hidden"

    def toggle(self) -> None:
        """Show it, or hide it."""
        self.on = not self.on
        self.nodes = None

    def follow(self, frame: SimulationFrame) -> None:
        """Show the demonstration at the frame's step."""
        shown = self.on and self._steps and self._steps[0].shape == frame.nodes.shape
        self.nodes = self._steps[min(frame.step, len(self._steps) - 1)] if shown else None


def _best(path: Path) -> list[FloatArray]:
    """Return the nodes of each step; none where the session has no success, or cannot be read."""
    try:
        with open_session(path) as session:
            infos = session.infos()
            good = [name for name, info in infos.items() if info.outcome == "success"]
            if not good:
                return []
            episode = session.episode(max(good, key=lambda name: infos[name].contact_final))
    except (DataError, OSError):
        return []
    return [truth.nodes for truth in episode.ground_truths() if truth is not None]
