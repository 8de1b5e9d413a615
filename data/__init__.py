"""Episodes, and recording them safely; numpy and h5py only. docs/how-to/sessions.md shows the package in use."""

from layflat.data.camera import CameraModel
from layflat.data.environment_spec import EnvironmentSpec
from layflat.data.errors import DataError
from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.structure_checks import Violation
from layflat.data.robot import ActionAxis, RobotSpec
from layflat.data.session.edit_log import Edit, EditLog, EpisodeEdits, read_log
from layflat.data.session.editor import SessionEditor
from layflat.data.session.episode_view import EpisodeView
from layflat.data.session.journal import JournalHandle, JournalWriter
from layflat.data.session.reader import Session, open_session
from layflat.data.session.recorder import EpisodeWriter, SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.tools.operations import filter_session, merge, split, trim
from layflat.data.tools.repair import RepairReport, repair
from layflat.data.tools.stats import ColumnStats, SessionStats, session_stats
from layflat.data.tools.validate import validate
from layflat.data.types import DisturbanceRecord, DragTarget, Episode, GroundTruth, Observation, Provenance, Step

__all__ = [
    "ActionAxis",
    "CameraModel",
    "ColumnStats",
    "DataError",
    "DemoInfo",
    "DisturbanceRecord",
    "DragTarget",
    "Edit",
    "EditLog",
    "EnvironmentSpec",
    "Episode",
    "EpisodeEdits",
    "EpisodeView",
    "EpisodeWriter",
    "GroundTruth",
    "JournalHandle",
    "JournalWriter",
    "Observation",
    "Provenance",
    "RepairReport",
    "RobotSpec",
    "SavedEpisode",
    "Session",
    "SessionEditor",
    "SessionRecorder",
    "SessionStats",
    "Step",
    "Violation",
    "filter_session",
    "merge",
    "open_session",
    "read_log",
    "repair",
    "session_stats",
    "split",
    "trim",
    "validate",
]
