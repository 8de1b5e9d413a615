"""ArmProcess: a simulated Franka arm in a process of its own, which speaks the robot's protocol on loopback."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from layflat.app.hardware.station_config import StationError
from layflat.app.support.errors import UsageError
from layflat.app.workers.process import configure_child

START_S = 60.0
HAND_N_M, HAND_LIMIT_N, HAND_DAMPING = 300.0, 25.0, 20.0
"""Spring, strength and damping (N s/m) of a person's hand that guides the twin's arm."""
CHECK_TICKS, TICK_S = 5, 0.001
HAND_BODY = "robot0_hand"
"""Name that franky-sim gives the hand of its first robot."""


class ArmProcess:
    """The server of one arm; `host` is where the robot answers."""

    def __init__(self, joints: Sequence[float]) -> None:
        """Start it with the joint angles ``joints``, (7,) rad; StationError where it does not come up."""
        context = get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, list(joints), os.getpid()), daemon=True)
        self._process.start()
        theirs.close()
        try:
            answer = self._connection.recv() if self._connection.poll(START_S) else None
        except EOFError:
            answer = None
        if answer is None:
            self.close()
            raise StationError("the twin's arm does not start; try `layflat doctor`")
        if answer.startswith("missing"):
            self.close()
            raise UsageError("the twin needs its libraries; install layflat[station]")
        self.host: str = answer

    def push(self, hand_m: Sequence[float] | None) -> None:
        """Pull the hand towards a point in the base's frame, (3,) m, as a person does; None lets go."""
        self._connection.send(None if hand_m is None else [float(value) for value in hand_m])

    def kill(self) -> None:
        """Cut the connection at once, as a power cut does."""
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        """End the process; may be called twice."""
        with contextlib.suppress(OSError):
            self._connection.close()
        self._process.join(2.0)
        if self._process.is_alive():
            self.kill()


def _serve(connection: Connection, joints: list[float], parent: int) -> None:
    configure_child(parent)
    try:
        from franky_sim import SimulationServer
        from franky_sim.mujoco_simulator import MujocoSimulator
    except ImportError:
        connection.send("missing")
        return
    with MujocoSimulator() as simulator, contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        robot = simulator.add_robot(initial_q=joints)
        with SimulationServer(simulator) as server:
            hand, target, ticks = _Hand(simulator), None, 0
            connection.send(robot.hostname)
            while True:
                ticks += 1
                if ticks % CHECK_TICKS == 0 and connection.poll():
                    target = connection.recv()
                hand.pull(target)
                server.run_once(True)


class _Hand:
    """A person's hand at the simulated arm."""

    def __init__(self, simulator: Any) -> None:
        self._data, self._body = simulator.data, simulator.model.body(HAND_BODY).id
        self._before = np.array(self._data.xpos[self._body])

    def pull(self, target: list[float] | None) -> None:
        """Apply the hand's force for one tick of 1 ms; None: it is away."""
        here = np.array(self._data.xpos[self._body])
        speed, self._before = (here - self._before) / TICK_S, here
        self._data.xfrc_applied[self._body, :3] = 0.0
        if target is not None:
            force = HAND_N_M * (np.array(target) - here) - HAND_DAMPING * speed
            size = float(np.linalg.norm(force))
            self._data.xfrc_applied[self._body, :3] = force * min(1.0, HAND_LIMIT_N / max(size, 1e-9))
