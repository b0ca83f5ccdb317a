"""Inputs and outputs of a module, and waiting for an input."""
