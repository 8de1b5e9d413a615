"""`layflat data split|filter|merge|trim|repair`: sessions made of sessions, each complete or not there."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError, say
from layflat.app.support.session_lines import NAMED_MAX
from layflat.data.format import schema
from layflat.data.session.reader import open_session
from layflat.data.tools import operations
from layflat.data.tools.repair import repair as repair_session
from layflat.data.types import Outcome

PART_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def split(path: Path, out: Path, *, shares: Sequence[str], seed: int, force: bool) -> None:
    """Deal the episodes out into ``out/NAME.h5``, one for each ``NAME=SHARE``."""
    known = dict(_share(text) for text in shares)
    if len(known) < len(shares):
        raise UsageError(f"--share names a part twice ({', '.join(shares)}); give each part one share")
    targets = {name: out / f"{name}.h5" for name in known}
    for target in targets.values():
        validators.writable_file(target, force=force)
    parts = operations.split(path, targets, known, seed, force=force)
    for name, members in parts.items():
        print(f"wrote {len(members)} episodes {targets[name]}")


def _share(text: str) -> tuple[str, float]:
    """Parse NAME=SHARE; UsageError where it is none."""
    name, _, number = text.partition("=")
    try:
        share = float(number)
    except ValueError:
        share = math.nan
    if not PART_NAME.fullmatch(name) or not 0 < share < math.inf:
        raise UsageError(f"--share is {text!r}; it must be a name and a number above 0, such as train=0.8")
    return name, share


def filter_episodes(
    path: Path,
    out: Path,
    *,
    outcome: Outcome | None,
    source: str | None,
    cloth: str | None,
    n_steps: tuple[int | None, int | None],
    contact: tuple[float | None, float | None],
    force: bool,
) -> None:
    """Copy the episodes that meet every given condition."""
    validators.writable_file(out, force=force, suffix=validators.SESSION_SUFFIXES)
    with open_session(path) as session:
        total, names = len(session), session.select(outcome=outcome)
    if not names:
        raise UsageError(f"none of the {total} episodes of {path} is a {outcome}; choose another outcome")
    names = operations.filter_session(
        path,
        out,
        source=source,
        cloth=cloth,
        length=_limits("steps", n_steps),
        final_contact=_limits("contact", contact),
        names=names,
        force=force,
    )
    print(f"wrote {len(names)} of {total} episodes {out}")


def _limits(what: str, limits: tuple[float | None, float | None]) -> tuple[float, float] | None:
    """Return smallest and largest value, or None where neither is given."""
    least, most = limits
    if least is None and most is None:
        return None
    low, high = -math.inf if least is None else float(least), math.inf if most is None else float(most)
    if not low <= high:
        raise UsageError(f"--min-{what} is {least} and --max-{what} is {most}; nothing can pass both")
    return low, high


def merge(paths: Sequence[Path], out: Path, *, force: bool) -> None:
    """Merge sessions into one."""
    for path in paths:
        if out.exists() and path.exists() and out.samefile(path):
            raise UsageError(f"{out} is one of the files to merge; give another name")
    validators.writable_file(out, force=force, suffix=validators.SESSION_SUFFIXES)
    left_out: list[operations.MergedCopy] = []
    names = operations.merge(paths, out, force=force, on_copy=left_out.append)
    if left_out:
        more = f" and {len(left_out) - NAMED_MAX} more" if len(left_out) > NAMED_MAX else ""
        count = "one episode is a copy and is" if len(left_out) == 1 else f"{len(left_out)} episodes are copies and are"
        say(f"{count} taken once, as the first is labelled: {', '.join(map(_copy_text, left_out[:NAMED_MAX]))}{more}")
    print(f"wrote {len(names)} episodes of {len(paths)} sessions {out}")


def _copy_text(copy: operations.MergedCopy) -> str:
    """Return "demo_3 of b.h5 is demo_0", with the labels where they differ."""
    own, kept = (copy.outcome, copy.kept_outcome) if copy.outcome != copy.kept_outcome else ("", "")
    return f"{copy.name}{own and f' ({own})'} of {copy.path} is {copy.kept}{kept and f' ({kept})'}"


def trim(path: Path, out: Path, *, episode: int, start: int, stop: int | None, force: bool) -> None:
    """Cut an episode to steps ``start`` to ``stop - 1``."""
    validators.writable_file(out, force=force, suffix=validators.SESSION_SUFFIXES)
    name = schema.demo_name(episode)
    with open_session(path) as session:
        before = session.info(name)
    cut = operations.trim(path, out, name=name, start=start, stop=before.n_steps if stop is None else stop, force=force)
    print(f"wrote {name} with {cut.n_steps} of {before.n_steps} steps, {cut.outcome} {out}")


def repair(path: Path, out: Path | None, *, force: bool) -> None:
    """Save the intact episodes of a damaged file or a killed recording, in place or into ``out``."""
    if out is not None:
        validators.writable_file(out, force=force, suffix=validators.SESSION_SUFFIXES)
    report = repair_session(path, out, force=force)
    for violation in report.lost:
        print(f"lost {violation.path}: {violation.message}")
    for name in report.recovered:
        print(f"recovered {name} from an interrupted recording")
    print(f"wrote {len(report.intact) + len(report.recovered)} episodes {report.target}")
    if report.original is not None:
        print(f"the damaged file is {report.original}")
    if report.lost:
        count = "one part" if len(report.lost) == 1 else f"{len(report.lost)} parts"
        raise LayflatError(f"{count} of {path} could not be read; everything else is in {report.target}")
