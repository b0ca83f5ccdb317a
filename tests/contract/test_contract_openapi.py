"""The committed OpenAPI document: what the service says, valid, and fit to make a client of."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from openapi_spec_validator import validate
from repository import ROOT

from app.configuration.configuration import Configuration
from app.http.documentation import render
from app.main import create_app

COMMITTED = ROOT / "openapi" / "openapi.json"
DOCUMENT: dict[str, Any] = json.loads(COMMITTED.read_text(encoding="utf-8"))
UNSAFE = ("post", "put", "patch", "delete")


def operations() -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, item in DOCUMENT["paths"].items():
        for method, operation in item.items():
            yield method, path, operation


each_operation = pytest.mark.parametrize(
    ("method", "path", "operation"), list(operations()), ids=[o["operationId"] for _, _, o in operations()]
)


def test_it_is_what_the_service_says() -> None:
    drifted = render(create_app(Configuration()).openapi()) != COMMITTED.read_text(encoding="utf-8")
    assert not drifted, "openapi/openapi.json drifted: run `make openapi` and look at what changed"


def test_it_is_valid_3_1_0() -> None:
    assert DOCUMENT["openapi"] == "3.1.0"
    validate(DOCUMENT)
    assert "itemSchema" not in json.dumps(DOCUMENT)


def test_every_operation_has_a_name_of_its_own() -> None:
    names = [operation["operationId"] for _, _, operation in operations()]
    assert len(set(names)) == len(names)
    assert all(name.isidentifier() and name == name.lower() and len(name) <= 24 for name in names)


@each_operation
def test_an_operation_says_what_it_does(method: str, path: str, operation: dict[str, Any]) -> None:
    assert operation["summary"]
    assert operation["description"]
    assert len(operation["tags"]) == 1
    assert operation["tags"][0] in [tag["name"] for tag in DOCUMENT["tags"]]


@each_operation
def test_an_operation_documents_its_problems(method: str, path: str, operation: dict[str, Any]) -> None:
    needed = {"401", "421", "422"}
    if "{node}" in path:
        needed |= {"404"}
    if method in UNSAFE:
        needed |= {"403", "413", "415"}
    if "/axes/{axis}/" in path and method in UNSAFE and "/positions" not in path:  # what asks the module
        needed |= {"409", "502", "503", "504"}
    assert needed <= set(operation["responses"])
    for status, response in operation["responses"].items():
        if int(status) >= 400 and path != "/readyz":
            [(media_type, content)] = response["content"].items()
            assert media_type == "application/problem+json"
            assert content["schema"] == {"$ref": "#/components/schemas/Problem"}
            assert content["examples"]


@each_operation
def test_an_operation_has_examples(method: str, path: str, operation: dict[str, Any]) -> None:
    if "requestBody" in operation:
        for content in operation["requestBody"]["content"].values():
            assert examples_of(content["schema"]), "of the request"
    for response in (r for s, r in operation["responses"].items() if s.startswith("2")):
        [content] = response["content"].values()
        assert content.get("example") or examples_of(content["schema"]), "of the reply"


def examples_of(schema: dict[str, Any]) -> bool:
    """Whether a schema, or those that it is made of, has examples."""
    if "$ref" in schema:
        return examples_of(DOCUMENT["components"]["schemas"][schema["$ref"].rpartition("/")[2]])
    if schema.get("examples"):
        return True
    return any(examples_of(part) for part in schema.get("anyOf", []))


def test_every_number_with_a_unit_says_so() -> None:
    bodies = DOCUMENT["components"]["schemas"]
    for name in ("MoveBody", "VelocityBody"):
        assert "unit" in bodies[name]["required"], name
    assert set(bodies["Quantity"]["required"]) == {"steps", "value", "unit"}


def test_a_client_can_be_generated(tmp_path: Path) -> None:
    config = tmp_path / "config.yaml"
    overrides = "content_type_overrides: {text/csv: application/octet-stream}"  # it knows no CSV by itself
    config.write_text(f"post_hooks: []\n{overrides}\n", encoding="utf-8")
    output = tmp_path / "client"
    generator = [sys.executable, "-m", "openapi_python_client", "generate", "--fail-on-warning"]
    done = subprocess.run(
        [*generator, "--path", COMMITTED, "--output-path", output, "--meta", "none", "--config", config],
        capture_output=True, text=True, timeout=50, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert (output / "api" / "moves" / "move_axis.py").is_file()
    source = (output / "api" / "axes" / "enable_axis.py").read_text(encoding="utf-8")
    assert "application/json" in source, "a generated client sends the content type that a command needs"
