"""Activities by the type of their request. A new one adds a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from layflat.app.workstation.session.activity_process import Activity, Endpoint
from layflat.app.workstation.session.place_activity import PlaceActivity
from layflat.app.workstation.session.record_activity import RecordActivity
from layflat.app.workstation.session.requests import ActivityRequest, PlaceRequest, RecordRequest

ACTIVITIES: Mapping[type[ActivityRequest], Callable[[Any, Endpoint], Activity]] = {
    PlaceRequest: PlaceActivity,
    RecordRequest: RecordActivity,
}


def make_activity(request: ActivityRequest, endpoint: Endpoint) -> Activity:
    """Make the activity of a request."""
    return ACTIVITIES[type(request)](request, endpoint)
