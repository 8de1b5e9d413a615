"""What an episode is, and keeping it safe: numpy and h5py only. docs/how-to/sessions.md shows it in use."""

from layflat.data.errors import DataError
from layflat.data.session.demo_info import DemoInfo
from layflat.data.session.episode_writer import EpisodeWriter
from layflat.data.session.journal import JournalHandle, JournalWriter
from layflat.data.session.reader import EpisodeView, Session, open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.tools.operations import filter_session, merge, split, trim
from layflat.data.tools.repair import RepairReport, repair
from layflat.data.tools.stats import ColumnStats, SessionStats, session_stats
from layflat.data.tools.validate import Violation, validate
from layflat.data.types import DisturbanceRecord, DragTarget, Episode, GroundTruth, Observation, Provenance, Step

__all__ = [
    "ColumnStats",
    "DataError",
    "DemoInfo",
    "DisturbanceRecord",
    "DragTarget",
    "Episode",
    "EpisodeView",
    "EpisodeWriter",
    "GroundTruth",
    "JournalHandle",
    "JournalWriter",
    "Observation",
    "Provenance",
    "RepairReport",
    "SavedEpisode",
    "Session",
    "SessionRecorder",
    "SessionStats",
    "Step",
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
