"""The command line imports what it runs, and no more."""

from __future__ import annotations

import subprocess
import sys

import pytest

LOOK = "import sys, app.cli; app.cli.command_line([{name!r}]); print(*sys.modules)"


@pytest.mark.parametrize(("name", "simulator"), [("serve", False), ("simulate", True)])
def test_a_service_carries_no_simulator(name: str, simulator: bool):
    """It would make the start longer, and take memory."""
    look = [sys.executable, "-c", LOOK.format(name=name)]
    modules = subprocess.run(look, capture_output=True, text=True, check=True).stdout.split()
    assert f"app.commands.{name}" in modules
    assert any(module.startswith("drivers.sim") for module in modules) is simulator
