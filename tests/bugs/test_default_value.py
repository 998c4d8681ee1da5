"""A message definition whose default value is no number was a traceback: the parser's error for it was not known."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.errors import LogError
from geomphys.recording.decoders import make_decoder
from geomphys.recording.reader import LogChannel


def test_a_default_value_that_is_no_number_is_an_error_of_the_log(tmp_path: Path) -> None:
    definition = b"float64 x w\nstring[] name\n"
    channel = LogChannel(1, "/a", "some_msgs/msg/Thing", "ros2msg", definition, "cdr", 0, 0, 0)
    with pytest.raises(LogError, match="definition cannot be read"):
        make_decoder(channel, "some_msgs/msg/Thing")
