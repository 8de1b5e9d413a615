"""The seam between the robot and who holds the cloth: two free pickers, or a Panda arm with a two-clip hanger."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, Protocol, TypeAlias

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

if TYPE_CHECKING:
    from layflat.sim.cloth.cloth import Cloth

Control: TypeAlias = Literal["impedance", "position"]
"""How an arm is driven: it yields to a push, or its joints are stiff."""


class Robot(Protocol):
    """Holds the cloth's two corners and carries them along displacements, one per step.

    A holder is made at its home pose with the clips or pickers at ``corner_positions()``; the caller puts the cloth's
    corner nodes there and calls ``grip``.
    """

    spec: ClassVar[RobotSpec]
    """Name and action axes."""
    start_step_m: ClassVar[float]
    """Largest random displacement along each axis in one of the start's steps."""

    def __init__(self, cloth: Cloth, corner_positions: FloatArray, *, control: Control = "impedance") -> None: ...

    def corner_positions(self) -> FloatArray:
        """(2, 3) m, world: where the two held corners really are; row 0 at +y."""

    def position(self) -> FloatArray:
        """(3,) m, world: the hanger's centre between the clips, or the midpoint of the pickers."""

    def joint_angles(self) -> FloatArray:
        """(J,) rad: the arm's joints now; none where no arm holds the cloth."""

    def grip(self) -> None:
        """Anchor the cloth's corners; they must already be at ``corner_positions()``."""

    def start_step(self, action: FloatArray, substeps: int) -> None:
        """Begin one step: ``action`` (A,) m in the order of its axes, spread evenly over ``substeps``."""

    def start_guided_step(self, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Begin one step in which a hand leads: ``hand_m`` (3,) m for a hanger, (2, 3) m for pickers; None: no hand.

        ``load_n``: weight of the cloth that hangs from the holder.
        """

    def before_substep(self) -> None:
        """Called before each substep: move the kinematic bodies or apply the torques."""

    def rest(self) -> None:
        """Stay in place while the world is only stepped (to time bare substeps); the next step goes on as before."""
