"""The command line imports what it runs, and no more."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from app.cli import UNASKED, without

LOOK = """
import sys, app.cli
with app.cli.without(app.cli.UNASKED):
    app.cli.command_line([{name!r}])
print(*sys.modules)
"""


@pytest.mark.parametrize(("name", "simulator"), [("serve", False), ("simulate", True)])
def test_a_service_carries_no_simulator(name: str, simulator: bool):
    """It would make the start longer, and take memory."""
    look = [sys.executable, "-c", LOOK.format(name=name)]
    modules = subprocess.run(look, capture_output=True, text=True, check=True).stdout.split()
    assert f"app.commands.{name}" in modules
    assert any(module.startswith("drivers.sim") for module in modules) is simulator
    if name == "serve":
        assert not {*UNASKED, "yaml", "pydantic_settings", "canopen", "httpx"} & set(modules)


def test_what_is_hidden_counts_as_not_installed_and_only_meanwhile(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(sys.modules, "wave", raising=False)
    with without(("wave", "json")):
        with pytest.raises(ImportError):
            importlib.import_module("wave")
        assert importlib.import_module("json") is sys.modules["json"], "it was imported already"
    assert importlib.import_module("wave") is not None
