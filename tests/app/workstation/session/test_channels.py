"""Values in shared memory: the newest one, inputs and frames."""

from __future__ import annotations

import multiprocessing
from dataclasses import fields

import numpy as np
import pytest

from layflat.app.workstation.playback import Playback
from layflat.app.workstation.session.frame_channel import FRAME_BYTES
from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.types import DragTarget
from layflat.tests.app.workstation.fakes import WIDE, write_for
from layflat.tests.factories import ROBOT_SPECS

CONTEXT = multiprocessing.get_context("forkserver")


def test_no_value_is_half_of_one_and_half_of_another():
    value = LatestValue(CONTEXT, 10 * WIDE)
    writer = CONTEXT.Process(target=write_for, args=(value, 1.5))
    writer.start()
    n_read, newest = 0, 0
    while writer.is_alive():
        found = value.read(newest)
        if found is None:
            continue
        number, one = found
        assert number > newest
        assert (one == number).all()
        newest, n_read = number, n_read + 1
    writer.join()
    assert writer.exitcode == 0
    assert n_read > 20


def test_only_a_newer_value_is_read():
    value = LatestValue(CONTEXT, 1000)
    assert value.read() is None
    for one in ("one", "a longer one", "two"):
        value.write(one)
    assert value.read() == (3, "two")
    assert value.read(3) is None
    with pytest.raises(ValueError, match="at most 1000"):
        value.write("x" * 1001)
    assert value.read() == (3, "two")


@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
@pytest.mark.parametrize("guided", [False, True])
def test_an_input_is_read_as_written(robot, guided):
    rng = np.random.default_rng(1)
    teleop = TeleopInput(
        motion=rng.uniform(-1, 1, robot.size), speed=0.25, connected=False, device="Pad é", problem="disconnected",
        hand=rng.normal(size=robot.hand_shape) if guided else None,
    )  # fmt: skip
    channel = LatestValue(CONTEXT, 16_000)
    channel.write((teleop, DragTarget(node=7, target_m=[0.1, 0.2, 0.3])))
    _, (found, drag) = channel.read()
    for item in fields(teleop):
        np.testing.assert_array_equal(getattr(found, item.name), getattr(teleop, item.name))
    assert drag.node == 7
    np.testing.assert_array_equal(drag.target_m, [0.1, 0.2, 0.3])


@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
def test_a_frame_is_read_as_written(robot, lying, make_episode):
    frame = Playback("s.h5 demo_0", lying(make_episode(robot=robot.name, disturbed=False))).frame(3)
    channel = LatestValue(CONTEXT, FRAME_BYTES)
    channel.write(frame)
    _, found = channel.read()
    for item in fields(frame):
        if item.name not in ("drag", "cloth_state", "pinhole"):
            np.testing.assert_array_equal(getattr(found, item.name), getattr(frame, item.name), err_msg=item.name)
    for key, value in vars(frame.pinhole).items():
        np.testing.assert_array_equal(vars(found.pinhole)[key], value, err_msg=key)
    for name in ("cloth_mask", "contact_mask", "coherence", "out_of_view", "cloth_pixels"):
        np.testing.assert_array_equal(getattr(found.cloth_state, name), getattr(frame.cloth_state, name), err_msg=name)
