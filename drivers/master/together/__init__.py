"""Several axes at once: coordinated moves that start on one SYNC, and trajectories."""
