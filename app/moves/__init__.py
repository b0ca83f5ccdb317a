"""The commands that move one axis: move, velocity, home, set position; and their dry runs."""
