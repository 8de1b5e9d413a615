"""What a person moves the cloth with: pads, keyboards, mice, each a `Teleoperator` of `TeleopInput`s."""

from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleop_policy import TeleopPolicy
from layflat.app.workstation.teleop.teleoperator import Button, Teleoperator, WindowTeleoperator

__all__ = ["Button", "Command", "TeleopInput", "TeleopPolicy", "Teleoperator", "WindowTeleoperator"]
