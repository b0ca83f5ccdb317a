"""`canaxis settings`: what it asks the service for, and what it makes of the answers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner

from app.cli import command_line
from app.configuration.sections import ConfigurationError

DIFF = {
    "equal": False,
    "compared": 3,
    "fields": [{"name": "x", "setting": "velocity", "kept": None, "wanted": {"value": 5, "unit": "mm/s"}}],
    "objects": [
        {"name": "x", "index": "0x2005", "sub": 0, "object": "Switch Parameters", "held": 0, "wanted": 3,
         "unit": "", "needs_disable": True},
    ],
    "unread": [],
}  # fmt: skip
APPLIED = {
    "revision": 4,
    "durable": True,
    "axes": [
        {"name": "x", "written": [{"index": "0x6081", "sub": 0, "name": "Velocity", "old": 1, "new": 2}]}
    ],
}
ANSWERS = {
    "": "nodes: []\n",
    "/diff": json.dumps(DIFF),
    "/apply": json.dumps(APPLIED),
    "/rollback": json.dumps(APPLIED),
}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The requests, in their order; each is answered."""
    seen: list[dict[str, Any]] = []

    def request(method: str, url: str, **options: Any) -> httpx.Response:
        seen.append({"method": method, "url": url, **options})
        return httpx.Response(200, text=ANSWERS[url.partition("/settings")[2]])

    monkeypatch.setattr(httpx, "request", request)
    return seen


def run(*arguments: str) -> Any:
    return CliRunner().invoke(command_line(["settings"]), ["settings", *arguments])


def test_an_export_is_yaml_and_the_token_comes_from_a_file(
    asked: list[dict[str, Any]], tmp_path: Path
) -> None:
    (tmp_path / "token").write_text("secret\n")
    result = run("export", "--url", "http://lab:1/", "--token-file", str(tmp_path / "token"))
    assert (result.exit_code, result.stdout) == (0, "nodes: []\n")
    assert asked[0]["url"] == "http://lab:1/api/v1/settings"
    assert asked[0]["headers"]["Authorization"] == "Bearer secret"
    assert asked[0]["headers"]["Accept"] == "application/yaml"


def test_a_file_is_sent_as_json_with_its_nodes_alone(asked: list[dict[str, Any]], tmp_path: Path) -> None:
    file = tmp_path / "canaxis.yaml"
    file.write_text(
        "bus: {channel: can0}\nnodes: [{id: 1, name: stage, axes: [{name: x, velocity: 5 steps/s}]}]\n"
    )
    result = run("apply", str(file))
    assert result.exit_code == 0
    assert "x 0x6081:0 Velocity: 1 -> 2" in result.stdout
    assert asked[0]["json"] == {
        "nodes": [{"id": 1, "name": "stage", "axes": [{"name": "x", "velocity": "5 steps/s"}]}]
    }


def test_a_difference_is_told_and_ends_with_1(asked: list[dict[str, Any]]) -> None:
    result = run("diff")
    assert result.exit_code == 1
    assert "x velocity: default -> 5 mm/s" in result.stdout
    assert (
        "x 0x2005:0 Switch Parameters: the module holds 0, wanted is 3 (only while disabled)" in result.stdout
    )
    assert asked[0]["json"] is None


def test_a_roll_back_names_its_revision(asked: list[dict[str, Any]]) -> None:
    assert run("rollback", "3").exit_code == 0
    assert asked[0]["json"] == {"revision": 3}


def test_what_the_service_refuses_is_told_with_its_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    refusal = httpx.Response(409, json={"detail": "Axis x moves.", "hint": "Stop it."})
    monkeypatch.setattr(httpx, "request", lambda *_, **__: refusal)
    result = run("rollback", "0")
    assert isinstance(result.exception, ConfigurationError)
    assert str(result.exception) == "Axis x moves.\nStop it."


@pytest.mark.parametrize("text", ["[1]", "a: 1", "{", "\x00"])
def test_a_file_that_is_none_is_refused_before_anything_is_sent(
    asked: list[dict[str, Any]], tmp_path: Path, text: str
) -> None:
    (tmp_path / "f.yaml").write_text(text)
    assert isinstance(run("apply", str(tmp_path / "f.yaml")).exception, ConfigurationError)
    assert asked == []
