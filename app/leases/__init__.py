"""Leases: exclusive control of axes, for a while."""
