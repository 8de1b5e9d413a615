"""What an episode is, and keeping it safe: numpy and h5py only. docs/data.md shows it in use."""

from data.info import DemoInfo
from data.journal import JournalTicket, JournalWriter
from data.operations import filter_session, merge, split, trim
from data.recorder import KeptEpisode, SessionRecorder
from data.repair import RepairReport, repair
from data.running import Running
from data.stats import ColumnStats, SessionStats, session_stats
from data.store import EpisodeView, Session, open_session
from data.types import DataError, DisturbanceRecord, Episode, Observation, Provenance, Pull, Step, Truth
from data.validate import Violation, validate

__all__ = [
    "ColumnStats",
    "DataError",
    "DemoInfo",
    "DisturbanceRecord",
    "Episode",
    "EpisodeView",
    "JournalTicket",
    "JournalWriter",
    "KeptEpisode",
    "Observation",
    "Provenance",
    "Pull",
    "RepairReport",
    "Running",
    "Session",
    "SessionRecorder",
    "SessionStats",
    "Step",
    "Truth",
    "Violation",
    "filter_session",
    "merge",
    "open_session",
    "repair",
    "session_stats",
    "split",
    "trim",
    "validate",
]
