"""What an episode is, and keeping it safe: numpy and h5py only."""

from data.decode import DemoInfo
from data.recorder import KeptEpisode, SessionRecorder
from data.store import Session, open_session
from data.types import DataError, Episode, Observation, Provenance, Step, Truth

__all__ = [
    "DataError",
    "DemoInfo",
    "Episode",
    "KeptEpisode",
    "Observation",
    "Provenance",
    "Session",
    "SessionRecorder",
    "Step",
    "Truth",
    "open_session",
]
