"""openapi/jog.md against the code: every example is a message, and every kind and close code is in it."""

from __future__ import annotations

import json
import re
from typing import Any, get_args

import pytest
from repository import ROOT

from app.jog import schemas, socket

PAGE = (ROOT / "openapi" / "jog.md").read_text(encoding="utf-8")
EXAMPLES: dict[str, Any] = {
    json.loads(block)["kind"]: json.loads(block) for block in re.findall(r"```json\n(.*?)\n```", PAGE, re.S)
}
CLIENT = {member.model_fields["kind"].annotation: member for member in get_args(schemas.ClientMessage)}
SERVER = {member.model_fields["kind"].default: member for member in schemas.ServerMessage.__subclasses__()}


def test_every_kind_has_its_example() -> None:
    client = {get_args(kind)[0] for kind in CLIENT}
    assert set(EXAMPLES) == client | set(SERVER)


@pytest.mark.parametrize("kind", sorted(EXAMPLES))
def test_every_example_is_a_message(kind: str) -> None:
    example = EXAMPLES[kind]
    if kind in SERVER:
        SERVER[kind].model_validate(example)
        known = set(SERVER[kind].model_fields)
    else:
        schemas.CLIENT_MESSAGES.validate_json(json.dumps(example))
        known = set(type(schemas.CLIENT_MESSAGES.validate_python(example)).model_fields)
    assert set(example) <= known
    required = {
        n for n, f in (SERVER.get(kind) or schemas.PingMessage).model_fields.items() if f.is_required()
    }
    assert kind not in SERVER or required <= set(example)


@pytest.mark.parametrize(
    ("model", "field"),
    [(schemas.AckMessage, "outcome"), (schemas.StoppedMessage, "reason"), (schemas.AckMessage, "jog")],
)
def test_every_word_is_explained(model: type[schemas.ServerMessage], field: str) -> None:
    for word in get_args(model.model_fields[field].annotation):
        assert f"`{word}`" in PAGE, word


def test_every_close_code_is_explained() -> None:
    for code in (socket.TOO_MANY, socket.TOO_SLOW, socket.RESTART, socket.UNKNOWN, socket.REFUSED):
        assert re.search(rf"^\| {code} \|", PAGE, re.M), code
