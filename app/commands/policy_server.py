"""`layflat policy serve`: a policy for programs of another Python or another machine."""

from __future__ import annotations

import contextlib
import http
import threading
from dataclasses import dataclass
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import Server, ServerConnection, serve

from layflat.app.support.errors import UsageError, say
from layflat.app.workers.interrupts import note_interrupts
from layflat.policy.base import Policy, PolicyError, continue_after_disturbance
from layflat.policy.foreign import wire
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import DEFAULT_ROBOT
from layflat.sim.simulation import ClothSimulation

HOST, PORT = "127.0.0.1", 8000
"""The port is openpi's."""


@dataclass(frozen=True, kw_only=True)
class PolicyServerConfig:
    """Which policy is served, and where."""

    policy: str
    """POLICY text, see `layflat.policy.spec.PolicySpec.parse`."""
    host: str = HOST
    port: int = PORT
    """0 takes a free one."""


class PolicyServer:
    """Serves one policy; each connection has its own, so that several environments run at the same time."""

    def __init__(self, config: PolicyServerConfig) -> None:
        """Listen; UsageError or PolicyError where the policy cannot be served."""
        self.policy = PolicySpec.parse(config.policy)
        if self.policy.builtin == SCRIPTED:
            raise UsageError(f"{SCRIPTED} looks at the mesh, which a client does not send; serve another policy")
        robot = DEFAULT_ROBOT if self.policy.robot is None else self.policy.robot.name
        self._metadata = {
            "policy": self.policy.label,
            "robot": None if self.policy.robot is None else robot,
            wire.ACTION_UNIT: wire.METRES,
            "images": self.policy.foreign is not None,
            "stateful": True,
            "max_extra_steps": int(getattr(self._make(robot), "max_extra_steps", 0)),
        }
        self._server: Server = serve(
            self._answer_all,
            config.host,
            config.port,
            compression=None,
            max_size=wire.MAX_BYTES,
            origins=[None],  # Programs send none; a page of somebody else in a browser does.
            process_request=_answer_health,
        )
        self.port = int(self._server.socket.getsockname()[1])

    def _make(self, robot: str, task: str = "place", cloth: str = "towel") -> Policy:
        # An environment that is never reset: a policy is made by the spec alone.
        return self.policy.make(ClothSimulation(SimConfig(robot=robot, task=task, cloth=cloth)))

    def run(self) -> None:
        """Serve until `close`."""
        self._server.serve_forever()

    def close(self) -> None:
        """Stop serving; may be called twice."""
        self._server.shutdown()

    def _answer_all(self, connection: ServerConnection) -> None:
        policy: Policy | None = None
        try:
            connection.send(wire.pack(self._metadata))
            for data in connection:
                message = wire.unpack(data)
                if policy is None or message.get("step") == 0:
                    policy = self._start(message)
                elif message.get("resumed"):
                    continue_after_disturbance(policy)
                connection.send(wire.pack(_answer(policy, message)))
        except (ValueError, TypeError) as error:  # Of a policy, of the simulation's names, of a message's values.
            say(str(error))
            with contextlib.suppress(ConnectionClosed):
                connection.send(str(error))
                connection.close(1011, "the policy failed")
        except ConnectionClosed:
            pass

    def _start(self, message: dict[str, Any]) -> Policy:
        names = {key: str(message[key]) for key in ("robot", "task", "cloth") if key in message}
        if "robot" not in names:
            raise PolicyError("the first observation of an episode needs robot, task, cloth, seed and step = 0")
        policy = self._make(**names)
        policy.reset(int(message.get("seed", 0)))
        return policy


def _answer(policy: Policy, message: dict[str, Any]) -> dict[str, Any]:
    decision = policy.act(wire.decode_observation(message))
    answer: dict[str, Any] = {wire.ACTIONS: decision.action[None], "reason": decision.reason}
    if decision.std is not None:
        answer["std"] = decision.std
    if decision.stop is not None:
        answer["stop"] = decision.stop
    return answer


def _answer_health(connection: ServerConnection, request: Request) -> Response | None:
    return connection.respond(http.HTTPStatus.OK, "OK\n") if request.path == "/healthz" else None


def serve_policy(config: PolicyServerConfig) -> None:
    """Serve a policy until Ctrl-C."""
    try:
        server = PolicyServer(config)
    except OSError as error:
        raise UsageError(f"{config.host}:{config.port} cannot be listened on: {error.strerror or error}") from error
    thread = threading.Thread(target=server.run, daemon=True)
    with note_interrupts() as interrupts:
        thread.start()
        print(f"serving {server.policy.label} at ws://{config.host}:{server.port}", flush=True)
        while not interrupts.received:
            thread.join(0.2)
    server.close()
