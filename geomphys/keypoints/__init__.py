"""Joint values from tracked points: bone lengths once a recording, then a damped Gauss-Newton fit each frame."""
