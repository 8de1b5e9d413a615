"""What an episode is, and keeping it safe: numpy and h5py only."""

from data.info import DemoInfo
from data.recorder import KeptEpisode, SessionRecorder
from data.store import EpisodeView, Session, open_session
from data.types import DataError, Episode, Observation, Provenance, Step, Truth

__all__ = [
    "DataError",
    "DemoInfo",
    "Episode",
    "EpisodeView",
    "KeptEpisode",
    "Observation",
    "Provenance",
    "Session",
    "SessionRecorder",
    "Step",
    "Truth",
    "open_session",
]
