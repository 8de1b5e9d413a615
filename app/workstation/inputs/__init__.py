"""What a person moves the cloth with: pads, keyboards, mice, each a `Source` of `Reading`s."""

from app.workstation.inputs.person import PersonPolicy
from app.workstation.inputs.reading import Control, Reading
from app.workstation.inputs.source import Button, Source, WindowSource

__all__ = ["Button", "Control", "PersonPolicy", "Reading", "Source", "WindowSource"]
