"""Calibration of a station: table plane, hand-eye transform, and how the cloth looks when it lies flat."""
