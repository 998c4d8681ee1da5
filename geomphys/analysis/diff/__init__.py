"""Two outputs compared: frames matched by time, every channel measured, shown as a page or as an overlay."""
