"""Where the repository is, for the tests that read its pages and start its commands."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
