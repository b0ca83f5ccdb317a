"""Positions of an axis that have names."""
