"""Names that a user gives for a simulation."""

from __future__ import annotations

import pytest

from layflat.app.support.errors import UsageError
from layflat.app.workers.sim_options import sim_config


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"task": "hanger"},
            "task 'hanger' is unknown; known ones are place, smooth; hanger is a robot: --robot hanger",
        ),
        ({"robot": "crumpled"}, r"robot 'crumpled' is unknown; .*; crumpled is a start: --start crumpled"),
        ({"robot": "arm"}, r"robot 'arm' is unknown; known ones are [^;]*"),
    ],
)
def test_a_name_of_another_setting_is_said_to_be_one(settings, message):
    with pytest.raises(UsageError, match=rf"^{message}$"):
        sim_config(**settings)
