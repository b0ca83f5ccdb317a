"""The way from an axis to its module: what all nodes of a bus share, and what the axes of one node share."""
