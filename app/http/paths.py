"""Where things are: what every path begins with, and the methods that change nothing."""

from __future__ import annotations

API = "/api/v1"
"""Where the API is."""
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
"""They change nothing."""


def operation_path(operation_id: str) -> str:
    """Where the operation is."""
    return f"{API}/operations/{operation_id}"
