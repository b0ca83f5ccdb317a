"""The client beside the service's own tables: every problem has a class, every field that it reads exists."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from repository import ROOT

from app.http.problems import PROBLEM_TYPES
from canaxis import errors, replies

SCHEMAS: dict[str, Any] = json.loads((ROOT / "openapi" / "openapi.json").read_text("utf-8"))["components"][
    "schemas"
]
NAMES = {
    "AxisStatuses": "AxisList",
    "AxisTrack": "AxisTrack",
    "Emergencies": "EmergencyList",
    "NamedPositions": "NamedPositionList",
    "Found": "FoundReply",
    "NodeStatuses": "NodeList",
    "ObjectValue": "ObjectReply",
    "PathLimits": "PathReply",
    "Write": "ChangeReply",
    "OperationStatuses": "OperationList",
    "Sight": "SightReply",
    "StopReport": "StopReply",
}
"""Where the client's name is not the schema's, or the schema's with `Reply` or `Status` behind it."""
FROM_HEADERS = {"etag"}
BLOCKER = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names!r}:
            raise ImportError(name + " is not for the client")

sys.meta_path.insert(0, Blocked())
import canaxis
print(canaxis.Client("http://127.0.0.1:8402").node("stage").axis("x"))
"""
SERVERS = {
    *(
        "app",
        "drivers",
        "can",
        "canopen",
        "fastapi",
        "pydantic",
        "pydantic_settings",
        "starlette",
    ),
    *("structlog", "typer", "uvicorn", "yaml"),
}


def schema_of(name: str) -> dict[str, Any]:
    stem = name.removesuffix("Status")
    wanted = (NAMES.get(name), f"{name}Reply", f"{stem}Reply", name)
    return next(SCHEMAS[each] for each in wanted if each in SCHEMAS)


def test_the_package_needs_nothing_of_the_server() -> None:
    code = BLOCKER.format(names=SERVERS)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Axis" in done.stdout


@pytest.mark.parametrize("code", PROBLEM_TYPES)
def test_every_problem_has_a_class_of_its_status(code: str) -> None:
    row = PROBLEM_TYPES[code]
    error = errors.of_problem({"code": code, "status": row.status, "detail": "So.", "hint": row.explanation})
    assert (error.status, error.hint) == (row.status, row.explanation)
    family = [kind.status_class for kind in type(error).__mro__ if issubclass(kind, errors.CanaxisError)]
    assert row.status in family or row.status in (400, 405, 408, 413, 415, 421), (
        "these are mistakes of the client itself"
    )


def test_every_code_that_a_class_is_named_for_is_the_services() -> None:
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and hasattr(kind, "codes")]
    named = {code for kind in kinds for code in vars(kind).get("codes", ())}
    assert named <= set(PROBLEM_TYPES)
    assert len(named) > 15


@pytest.mark.parametrize(
    "kind", [each for each in vars(replies).values() if is_dataclass(each) and each is not errors.Obstacle]
)
def test_every_field_that_the_client_reads_is_in_the_contract(kind: Any) -> None:
    schema = schema_of(kind.__name__)
    assert {field.name for field in fields(kind)} <= FROM_HEADERS | set(schema["properties"]), kind.__name__
