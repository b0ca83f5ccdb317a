"""Trajectories: uploads of points, read and handed to the master."""
