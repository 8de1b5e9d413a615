"""Layflat teaches a robot to lay cloth flat."""

from __future__ import annotations
