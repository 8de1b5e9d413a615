"""Formats of other tools: robomimic, LeRobot, csv."""
