"""RemotePolicy: a policy server, ``ws://host:port``, such as openpi's or that of `layflat policy serve`."""

from __future__ import annotations

import os
from collections import deque
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from layflat.data.arrays import FloatArray
from layflat.data.environment_spec import EnvironmentSpec
from layflat.data.types import ACTION_LIMIT_M, STOP_REASONS, Observation
from layflat.policy.base import Decision, Policy, PolicyError
from layflat.policy.foreign import wire
from layflat.policy.foreign.checked import CheckedPolicy

TIMEOUT_S = 30.0
"""Longest time for a connection and for an answer; a large model needs seconds for its first."""


@dataclass(frozen=True)
class PolicyServer:
    """The address of a policy server, in a form that each process can connect to."""

    url: str
    """``ws://host:port``; behind it ``?replan=N``, the number of steps of an answer that are carried out before the
    server is asked again (by default all), and ``&timeout=SECONDS``."""

    def __post_init__(self) -> None:
        parse_url(self.url)

    @property
    def label(self) -> str:
        """Name in tables."""
        parts = urlsplit(self.url)
        return f"{parts.hostname}-{parts.port}".replace(":", ".")

    def make(self, spec: EnvironmentSpec, name: str) -> Policy:
        """Connect; PolicyError where nothing answers."""
        return CheckedPolicy(RemotePolicy(self.url, spec, name), name=name, robot=spec.robot)


class RemotePolicy:
    """Asks a policy server for the next actions.

    A process that is forked in the middle of an episode makes a connection of its own. A server whose metadata say
    ``stateful`` then gets the observations of the episode once more, so that it is where it was.

    Parameters
    ----------
    url : str
        As in `PolicyServer`.
    spec : EnvironmentSpec
        The environment.
    name : str
        Name in tables.

    Raises
    ------
    PolicyError
        Where nothing answers at the address in time, or something else than a policy server does.
    """

    def __init__(self, url: str, spec: EnvironmentSpec, name: str) -> None:
        self.name, self.robot = name, spec.robot
        self.address, self._replan, self._timeout_s = parse_url(url)
        self._episode: dict[str, Any] = {"robot": spec.robot.name, "task": spec.task, "cloth": spec.cloth}
        self._episode["prompt"] = wire.PROMPT
        self._planned: deque[FloatArray] = deque()
        self._n_steps = 0
        self._sent: list[bytes] = []
        """Messages of this episode, for a server that has a state."""
        metadata = self._connect()
        self._scale = 1.0 if metadata.get(wire.ACTION_UNIT) == wire.METRES else ACTION_LIMIT_M
        self._images = bool(metadata.get("images", True))
        self._stateful = bool(metadata.get("stateful", False))
        extra = metadata.get("max_extra_steps", 0)
        if not isinstance(extra, int):
            raise PolicyError(f"{self.address} has max_extra_steps {extra!r}; it must be a whole number")
        self.max_extra_steps = extra

    def _connect(self) -> dict[str, Any]:
        """Connect, and return the server's metadata."""
        try:
            self._connection: ClientConnection = connect(
                self.address,
                compression=None,
                max_size=wire.MAX_BYTES,
                open_timeout=self._timeout_s,
                close_timeout=1,
                proxy=None,
            )
        except (OSError, WebSocketException) as error:
            reason = getattr(error, "strerror", None) or error
            raise PolicyError(f"no policy server answers at {self.address}: {reason}") from error
        self._process = os.getpid()
        return self._receive()

    def _exchange(self, message: bytes) -> dict[str, Any]:
        if os.getpid() != self._process:
            self._connect()
            for earlier in self._sent:
                self._send(earlier)
                self._receive()
        if self._stateful:
            self._sent.append(message)
        self._send(message)
        return self._receive()

    def _send(self, message: bytes) -> None:
        try:
            self._connection.send(message)
        except (OSError, WebSocketException) as error:
            raise PolicyError(f"{self.address} has closed the connection: {error}") from error

    def _receive(self) -> dict[str, Any]:
        try:
            data = self._connection.recv(timeout=self._timeout_s)
        except TimeoutError as error:
            raise PolicyError(f"{self.address} has not answered for {self._timeout_s:g} s") from error
        except (OSError, WebSocketException) as error:
            raise PolicyError(f"{self.address} has closed the connection: {error}") from error
        if isinstance(data, str):  # Servers of openpi send the traceback of a failure as text.
            lines = [line for line in data.splitlines() if line.strip()] or ["nothing"]
            raise PolicyError(f"{self.address} reports: {lines[-1].strip()[:200]}")
        return wire.unpack(data)

    def reset(self, seed: int) -> None:
        """Start a new episode; the server learns of it with the first observation."""
        self._episode |= {"seed": seed, "resumed": False}
        self._n_steps = 0
        self._planned.clear()
        self._sent.clear()

    def continue_after_disturbance(self) -> None:
        """Discard what was planned before the disturbance."""
        self._episode["resumed"] = True
        self._planned.clear()

    def act(self, observation: Observation) -> Decision:
        """Return the next planned action, or ask the server for more."""
        decision = Decision(action=self._planned.popleft()) if self._planned else self._ask(observation)
        self._n_steps += 1
        return decision

    def _ask(self, observation: Observation) -> Decision:
        message = wire.encode_observation(observation, images=self._images)
        answer = self._exchange(wire.pack({**message, **self._episode, "step": self._n_steps}))
        self._episode["resumed"] = False
        stop, std = answer.get("stop"), answer.get("std")
        if stop is not None and stop not in STOP_REASONS:
            raise PolicyError(f"{self.address} stops by {stop!r}; it must be one of {', '.join(STOP_REASONS)}")
        first, *rest = self._actions(answer)[: self._replan]
        self._planned.extend(rest)
        return Decision(action=first, std=std, stop=stop, reason=str(answer.get("reason", ""))[:100])

    def _actions(self, answer: dict[str, Any]) -> FloatArray:
        """Return the actions, (T, A) m."""
        size = self.robot.size
        try:
            actions = np.atleast_2d(np.asarray(answer[wire.ACTIONS], dtype=float))
        except (KeyError, TypeError, ValueError) as error:
            raise PolicyError(f"{self.address} answers without actions; its keys are {sorted(answer)[:8]}") from error
        if actions.ndim != 2 or actions.shape[1] != size or not len(actions):
            raise PolicyError(
                f"{self.address} answers actions of shape {actions.shape}; {self.robot} needs (T, {size})"
            )
        if not np.isfinite(actions).all():
            raise PolicyError(
                f"{self.address} answers actions that are not finite numbers, in step {self._n_steps + 1}"
            )
        return actions * self._scale


def parse_url(url: str) -> tuple[str, int | None, float]:
    """Return the address, the steps before the server is asked again, and the time limit of a policy's URL."""
    try:
        parts = urlsplit(url)
        options = {key: values[-1] for key, values in parse_qs(parts.query, keep_blank_values=True).items()}
        replan, timeout_s = int(options.pop("replan", 0)), float(options.pop("timeout", TIMEOUT_S))
        if options or replan < 0 or not 0 < timeout_s < 1e6 or not parts.hostname or not parts.port:
            raise ValueError(url)
    except ValueError as error:
        raise PolicyError(
            f"policy {url!r} is no address; it must be ws://HOST:PORT, with ?replan=STEPS&timeout=SECONDS if needed"
        ) from error
    return f"{parts.scheme}://{parts.netloc}{parts.path}", replan or None, timeout_s
