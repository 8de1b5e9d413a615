"""Makes sessions of sessions: merge, split, filter, trim.

Each result is written aside and renamed, complete and durable or not there, and replaces a file only with ``force``.
Episodes are copied without decoding, images included; each keeps its uid, which identifies it in every copy.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from layflat.data.atomic_files import PART_SUFFIX, WriterLock, atomic_path
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.demo_info import DemoInfo
from layflat.data.session.catalog import differences
from layflat.data.session.edit_log import log_path
from layflat.data.session.parts import part_files, parts_folder
from layflat.data.session.reader import Session, open_session
from layflat.data.session.session_writer import SessionFile, check_writable, write_errors, written_session


@dataclass(frozen=True, kw_only=True)
class MergedCopy:
    """An episode that `merge` left out, because an earlier one is the same."""

    path: Path
    name: str
    outcome: str
    kept: str
    """Name in the new session of the one that was taken."""
    kept_outcome: str


def merge(
    paths: Sequence[str | Path],
    target: str | Path,
    *,
    force: bool = False,
    on_copy: Callable[[MergedCopy], None] = lambda copy: None,
) -> tuple[str, ...]:
    """Merge sessions that agree in robot, task, physics, cloth, step and descriptor; return the names in ``target``.

    Episodes are renumbered in the order of the files. Those with the same identity or the same content are taken once,
    as the first is labelled; ``on_copy`` is called for each of the others. Users' masks are copied.
    """
    if not paths:
        raise DataError("nothing to merge; name at least one session")
    with ExitStack() as stack:
        sessions = [stack.enter_context(open_session(path)) for path in paths]
        for session in sessions[1:]:
            if session.shared != sessions[0].shared:
                raise DataError(
                    f"{session.path} has {differences(session.shared, sessions[0].shared)} as in {sessions[0].path};"
                    " only sessions that agree can be merged"
                )
        with new_session(target, force=force) as file:
            taken: dict[str, DemoInfo] = {}
            known: dict[str, str] = {}
            for session in sessions:
                names, contents = {}, session.contents()
                for name, info in session.infos().items():
                    new = known.get(info.uid) or known.get(contents[name])
                    if new is None:
                        new = schema.demo_name(len(taken))
                        session.copy_to(file, name, new)
                        taken[new] = info
                    else:
                        kept = taken[new].outcome
                        on_copy(
                            MergedCopy(path=session.path, name=name, outcome=info.outcome, kept=new, kept_outcome=kept)
                        )
                    names[name] = known[info.uid] = known[contents[name]] = new
                if session.catalog.main is not None:
                    file.copy_masks(session.catalog.main, names)
    return tuple(taken)


def split(
    path: str | Path,
    targets: Mapping[str, str | Path],
    shares: Mapping[str, float],
    seed: int,
    *,
    force: bool = False,
) -> dict[str, tuple[str, ...]]:
    """Deal the episodes out to the targets at random in these shares; return the names of the demos by target.

    ``shares`` are relative, by the targets' names; counts are rounded by largest remainder, and none may be empty.
    Episodes that are copies or share steps, see `Session.recordings`, go to the same target and count as one.
    """
    if not targets or targets.keys() != shares.keys():
        raise DataError(f"targets are {sorted(targets)} and shares are for {sorted(shares)}; both must name the same")
    if not all(np.isfinite(share) and share > 0 for share in shares.values()):
        raise DataError(f"shares are {dict(shares)}; each must be above 0")
    if len({Path(file).resolve() for file in targets.values()}) < len(targets):
        raise DataError("two of the targets are the same file; name one file for each")
    with open_session(path) as session, ExitStack() as stack:
        recordings = session.recordings()
        dealt = split_names(tuple(dict.fromkeys(recordings.values())), shares, seed)
        chosen = {key: with_copies(names, recordings) for key, names in dealt.items()}
        for name, file in targets.items():
            _copy_named(session, chosen[name], stack.enter_context(new_session(file, force=force)))
    return chosen


def with_copies(names: Collection[str], recordings: Mapping[str, str]) -> tuple[str, ...]:
    """Return in order the episodes that belong to one of ``names``, by what `Session.recordings` returned."""
    return tuple(name for name, first in recordings.items() if first in names)


def split_names(names: Sequence[str], shares: Mapping[str, float], seed: int) -> dict[str, tuple[str, ...]]:
    """Return each of ``names`` under one key of ``shares``; DataError where a key would get none."""
    weights = np.array(list(shares.values())) / sum(shares.values())
    counts = np.floor(weights * len(names)).astype(int)
    left = len(names) - counts.sum()
    counts[np.argsort(counts - weights * len(names), kind="stable")[:left]] += 1
    if not counts.all():
        raise DataError(
            f"{len(names)} episodes are too few for the shares {dict(shares)}; each part needs at least one"
        )
    order = np.random.default_rng(seed).permutation(len(names))
    parts = np.split(order, np.cumsum(counts)[:-1])
    return {key: tuple(names[i] for i in sorted(part)) for key, part in zip(shares, parts, strict=True)}


def filter_session(
    path: str | Path,
    target: str | Path,
    *,
    success: bool | None = None,
    source: str | None = None,
    cloth: str | None = None,
    length: tuple[float, float] | None = None,
    final_contact: tuple[float, float] | None = None,
    names: Collection[str] | None = None,
    force: bool = False,
) -> tuple[str, ...]:
    """Copy the episodes that meet all conditions (None: any) under their names; return these names.

    ``length`` in steps and the camera's ``final_contact`` in 0..1 are smallest and largest allowed values.
    """
    with open_session(path) as session:
        unknown = set(names or ()) - set(session.names)
        if unknown:
            session.info(min(unknown))
        chosen = tuple(
            name
            for name, info in session.infos().items()
            if (names is None or name in names)
            and success in (None, info.success)
            and source in (None, info.source)
            and cloth in (None, info.cloth)
            and _within(info.n_steps, length)
            and _within(info.contact_final, final_contact)
        )
        if not chosen:
            raise DataError(f"none of the {len(session)} episodes of {path} meets the conditions; nothing was written")
        with new_session(target, force=force) as file:
            _copy_named(session, chosen, file)
    return chosen


def trim(path: str | Path, target: str | Path, *, name: str, start: int, stop: int, force: bool = False) -> DemoInfo:
    """Copy a session with one episode cut to its steps ``start`` to ``stop - 1``; return the info of that one.

    It gets a new uid, since it is no longer the recording; ``first_step`` is the number of steps missing before it.
    Without its end it is ``partial`` and was ``interrupted``, unless the cloth lies as it did at that end.
    """
    with open_session(path) as session:
        session.preview_trim(name, start, stop)
        with new_session(target, force=force) as file:
            _copy_named(session, session.names, file)
    with open_session(target) as session:
        return session.info(name)


@contextmanager
def new_session(target: str | Path, *, force: bool) -> Iterator[SessionFile]:
    """Yield a session file that appears at ``target`` complete and durable when the block is left, or not at all."""
    path = Path(target)
    with write_errors(path):
        real = path.resolve()
        check_writable(path, real)
        log = log_path(real)
        for there in (path, log):
            if there.exists() and not force:
                raise DataError(f"{there} exists; give another name, or force to replace it")
        with WriterLock(parts_folder(real), path):
            if part_files(real):
                raise DataError(f"{path} has episodes that are not yet in it; repair it first")
            aside = parts_folder(real) / f"session.h5{PART_SUFFIX}"
            with atomic_path(real, aside), written_session(aside) as file:
                yield file
            log.unlink(missing_ok=True)  # It edited what was replaced.


def _copy_named(session: Session, names: Sequence[str], file: SessionFile) -> None:
    for name in names:
        session.copy_to(file, name)
    _copy_extras(session, names, file)


def _copy_extras(session: Session, names: Sequence[str], file: SessionFile) -> None:
    if session.catalog.main is not None:
        file.copy_extras(session.catalog.main, {name: name for name in names})


def _within(value: float, limits: tuple[float, float] | None) -> bool:
    return limits is None or limits[0] <= value <= limits[1]
