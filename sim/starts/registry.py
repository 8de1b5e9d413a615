"""Every start by its name. A new one adds a file and an entry here."""

from __future__ import annotations

from collections.abc import Mapping

from layflat.sim.starts.base import Start
from layflat.sim.starts.crumpled import CRUMPLED
from layflat.sim.starts.folded_corner import FOLDED_CORNER
from layflat.sim.starts.hanging import HANGING, HANGING_QUICK, SWINGING

STARTS: Mapping[str, Start] = {
    start.name: start for start in (HANGING, HANGING_QUICK, CRUMPLED, FOLDED_CORNER, SWINGING)
}
