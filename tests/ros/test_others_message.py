"""The other chairs of a building as a message for the page."""

from __future__ import annotations

import pytest

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import make
from waychair.ros.messages.others import others, read_others
from waychair.runtime.pages.chair_port import OthersView


def test_the_others_come_as_they_were_sent_and_other_texts_are_refused() -> None:
    view = OthersView(
        "Waits for chair 2 to leave the ward.",
        12.5,
        ((2, "Stands by."), (3, "")),
        4,
        "Goes first: you have an appointment.",
        True,
    )
    assert read_others(others(view)) == view
    with pytest.raises(MessageError, match="about other chairs cannot be read"):
        read_others(make("std_msgs/msg/String", '{"waits": 3}'))
