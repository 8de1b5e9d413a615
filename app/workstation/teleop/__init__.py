"""What a person moves the cloth with: pads, keyboards, mice, each a `Source` of `Reading`s."""

from layflat.app.workstation.teleop.teleop_input import Control, Reading
from layflat.app.workstation.teleop.teleop_policy import PersonPolicy
from layflat.app.workstation.teleop.teleoperator import Button, Source, WindowSource

__all__ = ["Button", "Control", "PersonPolicy", "Reading", "Source", "WindowSource"]
