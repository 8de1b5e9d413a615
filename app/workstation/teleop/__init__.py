"""Teleoperators: gamepads, keyboards and the mouse, each a source of `TeleopInput`."""
