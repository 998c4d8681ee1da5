"""One frame: the compiled step, its state, and the frames it is given."""
