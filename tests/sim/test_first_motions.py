"""What a person does first: lower the cloth straight down, at the default speed of a key or a stick."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.app.workstation.teleop.keyboard import SPEED
from layflat.data.types import ACTION_LIMIT_M
from layflat.sim.robots.registry import THESIS_ROBOTS
from layflat.tests.sim.helpers import fresh_process_outputs

DOWN = f"[0.0, 0.0, {-SPEED * ACTION_LIMIT_M}]"
_SCRIPT = """
import sys
from layflat.tests.sim.helpers import simulation
robot, cloth, seed, steps, move = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), eval(sys.argv[5])
with simulation(robot, seed, cloth=cloth) as sim:
    for step in range(steps):
        sim.step(sim.spec.robot.pack(move))
        if reason := sim.divergence_reason():
            break
    seen = reason, float(sim.robot.position()[2]), sim.cloth.contact_portion_true(sim.ground_truth().nodes)
    print(*seen, sep="/")
"""
MOVES = (DOWN, "[-0.01, 0.0, -0.01]", "[0.003, 0.0, -0.01]", "[0.0, 0.0, -0.02]")


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("robot", "cloth", "move", "steps"),
    [
        pytest.param("pickers", "napkin", DOWN, 45, id="fast"),
        *(
            pytest.param(robot, cloth, move, 60, marks=pytest.mark.slow)
            for robot in THESIS_ROBOTS
            for cloth, moves in (("napkin", MOVES), ("towel", (DOWN,)))
            for move in moves
        ),
    ],
)
def test_a_cloth_that_is_lowered_blindly_lies_in_a_heap_and_does_not_come_apart(
    robot: str, cloth: str, move: str, steps: int
) -> None:
    seeds = (900,) if steps == 45 else (900, 901)
    for output in fresh_process_outputs(_SCRIPT, *((robot, cloth, str(seed), str(steps), move) for seed in seeds)):
        reason, height, contact = output.split("/")
        assert reason == "None"
        assert float(contact) > 0.02
        assert np.isfinite(float(height))


_JAMMED = """
from layflat.tests.sim.helpers import simulation
with simulation("pickers", 900) as sim:
    for share in (1.0, 1.3):
        nodes = sim.cloth.nodes().copy()
        nodes[50] += (share - 1.0) * (nodes[50] - nodes[40])
        sim._nodes = nodes
        for move in ([0.01, 0.0, -0.01], [0.01, 0.0, 0.01]):
            before = sim.robot.position()
            sim.step(sim.spec.robot.pack(move))
            print(*(sim.robot.position() - before).round(3) + 0.0, sep="/", end="|")
            sim._nodes = nodes
"""


def test_a_jammed_cloth_lets_the_robot_move_up_alone() -> None:
    (moved,) = fresh_process_outputs(_JAMMED, ())
    assert moved == "0.01/0.0/-0.01|0.01/0.0/0.01|0.0/0.0/0.0|0.0/0.0/0.01|"
