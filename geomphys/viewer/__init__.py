"""Shows results in the rerun viewer and takes pictures of frames."""
