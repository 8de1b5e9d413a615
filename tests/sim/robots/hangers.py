"""A hanger that holds nothing, its control steps, and what drives its arm."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots.hanger import PandaHanger
from layflat.sim.robots.panda import JOINTS

START = (0.0, 0.45)
AXES = [0, 2]
JOINT_LOW_RAD = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
JOINT_HIGH_RAD = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
"""The maker's limits (soft limits of the robot description); Bullet itself stops at wider ones."""
Push = tuple[float, float, float]
NO_PUSH: Push = (0.0, 0.0, 0.0)


def bare_hanger(world: BulletWorld, start: tuple[float, float] = START, cloth: str = "towel", **options: str) -> Any:
    """Make a hanger without a cloth, which costs microseconds a substep."""
    spec = cloth_spec(cloth)
    return watched(PandaHanger(SimpleNamespace(world=world, spec=spec), spec.corners_at(*start), **options))  # type: ignore[arg-type]


def watched(hanger: Any) -> Any:
    """Return a hanger that remembers its ``torques`` and the ``pushes`` of a hand."""
    hanger.torques, hanger.pushes = np.zeros(JOINTS), []
    set_torques, push_tool = hanger.arm.set_torques, hanger.arm.push_tool

    def listen_to_torques(torques: FloatArray) -> None:
        hanger.torques = torques.copy()
        set_torques(torques)

    def listen_to_pushes(force: FloatArray, place: FloatArray) -> None:
        hanger.pushes.append(force)
        push_tool(force, place)

    hanger.arm.set_torques, hanger.arm.push_tool = listen_to_torques, listen_to_pushes
    return hanger


def joint_torques(hanger: Any) -> FloatArray:
    """Return the torques (7,) N m of the last substep: the impedance's, or the motors' under position control."""
    if hanger._control == "impedance":
        return hanger.torques
    arm = hanger.arm
    return np.array([s[3] for s in bullet.getJointStates(arm.body, range(JOINTS), physicsClientId=arm._client)])


def run_step(
    world: BulletWorld, hanger: Any, action: tuple[float, float] = (0.0, 0.0), push_n: Push = NO_PUSH
) -> FloatArray:
    """Simulate a control step of 0.1 s; return the largest torque of each joint, (7,) N m."""
    substeps = round(0.1 / world.substep_s)
    hanger.start_step(np.array(action), substeps)
    largest = np.zeros(JOINTS)
    for _ in range(substeps):
        hanger.before_substep()
        largest = np.maximum(largest, np.abs(joint_torques(hanger)))
        _substep(world, hanger, push_n)
    return largest


def guided_step(
    world: BulletWorld, hanger: Any, hand: FloatArray | None = None, push_n: Push = NO_PUSH, load_n: float = 0.0
) -> FloatArray:
    """Simulate a control step of 0.1 s in which a hand guides the hanger; return the hand's mean force, (3,) N."""
    substeps = round(0.1 / world.substep_s)
    hanger.start_guided_step(hand, substeps, load_n)
    forces = []
    for _ in range(substeps):
        hanger.before_substep()
        forces.append(hanger.pushes[-1])
        _substep(world, hanger, push_n)
    return np.mean(forces, axis=0)


def _substep(world: BulletWorld, hanger: Any, push_n: Push) -> None:
    if any(push_n):
        hanger.arm.push_tool(np.array(push_n, dtype=float), hanger.position())
    world.step()
