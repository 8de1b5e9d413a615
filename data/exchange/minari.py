"""Exports to a Minari data set: episodes as the environment of Gymnasium would have given them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from layflat.data.atomic_files import atomic_folder
from layflat.data.errors import DataError
from layflat.data.exchange.idle_end import kept_steps
from layflat.data.exchange.optional_imports import require
from layflat.data.format import schema
from layflat.data.session.reader import Session
from layflat.data.types import ACTION_LIMIT_M


def dataset_id(session: Session) -> str:
    """Return the name of a session's data set: ``hanger-place-towel-v0``."""
    return f"{session.robot}-{session.task}-{session.cloth}-v0"


def export_minari(
    session: Session,
    folder: Path,
    *,
    names: Iterable[str] | None = None,
    images: bool = True,
    trim_idle: bool = False,
    on_episode: Callable[[str], None] | None = None,
) -> str:
    """Write a Minari data set into ``folder``, which serves as MINARI_DATASETS_PATH; return the data set's name.

    An episode is truncated where it ends: the environment has no end but a diverged cloth, which terminates it.
    """
    require("minari")
    chosen = tuple(session.names if names is None else names)
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    # Minari joins a relative path twice.
    with atomic_folder(folder.absolute() / dataset_id(session)) as aside:
        (aside / "data").mkdir()
        _write(session, aside / "data", chosen, images=images, trim_idle=trim_idle, on_episode=on_episode)
    return dataset_id(session)


def _write(
    session: Session,
    data: Path,
    chosen: Sequence[str],
    *,
    images: bool,
    trim_idle: bool,
    on_episode: Callable[[str], None] | None,
) -> None:
    minari, storages = require("minari"), require("minari.dataset.minari_storage")
    keys = _keys(session, chosen, images)
    storage = storages.MinariStorage.new(
        data,
        observation_space=_observation_space(session, chosen[0], keys),
        action_space=require("gymnasium").spaces.Box(-1.0, 1.0, (session.robot.size,), np.float32),
        env_spec=_env_spec(session, chosen[0]),
        jpeg_encoding=False,
    )
    storage.update_metadata(
        {
            "dataset_id": dataset_id(session),
            "minari_version": minari.__version__,
            "algorithm_name": ", ".join(sorted({session.info(name).source for name in chosen})),
            "description": f"Layflat episodes of {session.path.name}: {_legend(keys)}.",
            "requirements": ["layflat"],
        }
    )
    storage.update_episodes(_buffers(session, chosen, keys, minari, trim_idle, on_episode))
    details = [_details(session, name) for name in chosen]
    storage.update_episode_metadata(details, list(range(len(chosen))))


def _keys(session: Session, names: Sequence[str], images: bool) -> list[str]:
    """Return the observations: those of the first episode, images only where all episodes have them."""
    found = [field.key for field in schema.OBSERVATION_FIELDS if not field.optional]
    for key in (schema.RGB, schema.DEPTH) if images else ():
        there = [session.row_shape(name, f"{schema.OBS}/{key}") is not None for name in names]
        if any(there) and not all(there):
            raise DataError(f"{names[there.index(False)]} has no {key}, but others have; leave out images")
        found += [key] if all(there) else []
    return found


def _observation_space(session: Session, name: str, keys: Sequence[str]) -> Any:
    spaces = require("gymnasium").spaces
    return spaces.Dict(
        {
            key: spaces.Box(
                *schema.OBSERVATION_LIMITS[key], session.row_shape(name, f"{schema.OBS}/{key}"), _dtype(key)
            )  # type: ignore[misc]
            for key in keys
        }
    )


def _dtype(key: str) -> type:
    return np.uint8 if key == schema.RGB else np.float32


def _env_spec(session: Session, name: str) -> Any:
    """Return how Gymnasium makes the environment of an episode again; None for a real robot."""
    if session.physics == "real":
        return None
    keys = (schema.ROBOT, schema.CLOTH, schema.TASK, schema.PHYSICS)
    settings = session.settings(name)
    registration = require("gymnasium.envs.registration")
    return registration.EnvSpec(
        schema.ENV_NAME,
        entry_point="layflat.sim.env:ClothPlaceEnv",
        max_episode_steps=200,
        kwargs={key: session.shared[key] for key in keys} | settings,
    )


def _buffers(
    session: Session,
    names: Sequence[str],
    keys: Sequence[str],
    minari: Any,
    trim_idle: bool,
    on_episode: Callable[[str], None] | None,
) -> Iterator[Any]:
    images = schema.RGB in keys or schema.DEPTH in keys
    for number, name in enumerate(names):
        info, rows = session.info(name), session.rows(name, images=images)
        rewards = session.array(name, schema.REWARDS)
        count = kept_steps(session, name, trim_idle=trim_idle)
        ended = np.arange(1, count + 1) == count
        unstable = info.stopped_by == "unstable"
        truth = (schema.CONTACT_TRUE, schema.FLAT_AREA) if schema.STATES in rows else ()
        yield minari.data_collector.EpisodeBuffer(
            id=number,
            seed=info.seed if info.seed >= 0 else None,
            observations={
                key: np.clip(rows[key][: count + 1], *schema.OBSERVATION_LIMITS[key]).astype(_dtype(key))
                for key in keys
            },
            actions=(rows[schema.ACTION_M][:count] / ACTION_LIMIT_M).astype(np.float32),
            rewards=rewards[:count],
            terminations=ended & unstable,
            truncations=ended & (not unstable),
            infos={key.rpartition("/")[2]: rows[key][: count + 1, 0] for key in truth} or None,
        )
        if on_episode is not None:
            on_episode(name)


def _details(session: Session, name: str) -> dict[str, Any]:
    info = session.info(name)
    keys = ("uid", "outcome", "source", "stopped_by", "disturbance", "first_step")
    camera = session.camera_of(name)
    return {"name": name, **{key: getattr(info, key) for key in keys}, "camera": camera.to_json() if camera else ""}


def _legend(keys: Sequence[str]) -> str:
    fields = {field.key: field for field in schema.OBSERVATION_FIELDS}
    units = {key: f"{key} ({fields[key].unit}, {fields[key].frame})" for key in keys}
    return f"observations {', '.join(units.values())}; an action of 1 moves {ACTION_LIMIT_M * 1000:g} mm in a step"
