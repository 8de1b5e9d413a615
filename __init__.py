"""Layflat teaches a robot to lay cloth flat."""

from __future__ import annotations

from layflat.sim.registration import register_environments

register_environments()
