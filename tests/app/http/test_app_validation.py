"""What a client reads about a request that doesn't fit: one sentence a field, naming what it takes."""

from __future__ import annotations

import re
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from app.http.validation import of_unreadable, of_validation
from app.moves.schemas import HomeBody, MoveBody
from app.objects.schemas import ObjectBody
from app.stop.schemas import StopBody

GOOD = {"target": 1, "unit": "steps"}


def explained(model: type[BaseModel], body: object) -> dict[str, str]:
    """What the reply says of each field."""
    with pytest.raises(ValidationError) as caught:
        model.model_validate(body)
    items: list[dict[str, Any]] = [{**e, "loc": ("body", *e["loc"])} for e in caught.value.errors()]
    reply = of_validation(items, list(model.model_fields))
    assert reply.status == 422
    assert reply.body["code"] == "bad_request"
    assert reply.body["hint"]
    return {error["field"]: error["message"] for error in reply.body["errors"]}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_number_is_finite(value: float) -> None:
    assert explained(MoveBody, GOOD | {"target": value}) == {"target": "must be a finite number"}


@pytest.mark.parametrize("value", [True, "7", None, [1], {}])
def test_a_number_is_nothing_else(value: object) -> None:
    assert explained(MoveBody, GOOD | {"target": value}) == {"target": "must be a number"}


@pytest.mark.parametrize("value", [0, -1, -0.5])
def test_a_rate_is_above_0(value: float) -> None:
    assert explained(MoveBody, GOOD | {"velocity": value}) == {"velocity": "must be above 0"}


@pytest.mark.parametrize(
    ("model", "body", "field", "message"),
    [
        (MoveBody, {"target": 1}, "unit", "is required"),
        (MoveBody, GOOD | {"relative": 1}, "relative", "must be true or false"),
        (MoveBody, GOOD | {"unit": 7}, "unit", "must be a text"),
        (MoveBody, GOOD | {"unit": ""}, "unit", "must have 1 or more characters"),
        (MoveBody, GOOD | {"unit": "x" * 17}, "unit", "must have at most 16 characters"),
        (MoveBody, GOOD | {"unit": "\ud800"}, "unit", "must be a text in Unicode"),
        (MoveBody, [], "body", "must be a JSON object"),
        (HomeBody, {"method": 19.0}, "method", "must be a whole number"),
        (HomeBody, {"method": 128}, "method", "must be at most 127"),
        (HomeBody, {"method": -129}, "method", "must be at least -128"),
        (HomeBody, {"timeout_s": "3"}, "timeout_s", "must be a number"),
        (HomeBody, {"timeout_s": 0}, "timeout_s", "must be above 0"),
        (StopBody, {"reason": "x" * 201}, "reason", "must have at most 200 characters"),
        (ObjectBody, {"value": None}, "value", "must be a number, a text, true or false"),
        (ObjectBody, {"value": float("inf")}, "value", "must be a finite number"),
    ],
)
def test_each_field_says_what_it_takes(
    model: type[BaseModel], body: object, field: str, message: str
) -> None:
    assert explained(model, body) == {field: message}


def test_an_unknown_field_is_told_which_there_are() -> None:
    said = explained(MoveBody, GOOD | {"speed": 3})["speed"]
    assert "target, unit, relative, velocity" in said


def test_the_detail_is_a_sentence_of_all_fields() -> None:
    reply = of_validation(
        [
            {"type": "missing", "loc": ("body", "target"), "msg": "m"},
            {"type": "less_than_equal", "loc": ("query", "wait"), "msg": "m", "ctx": {"le": 600.0}},
        ]
    )
    assert reply.body["detail"] == "target is required; wait must be at most 600."


def test_many_errors_are_listed_but_not_all_told() -> None:
    items = [{"type": "missing", "loc": ("body", f"field{n}"), "msg": "m"} for n in range(9)]
    body = of_validation(items).body
    assert len(body["errors"]) == 9
    assert body["detail"].endswith("and 4 more.")


def test_one_entry_a_field() -> None:
    items = [{"type": kind, "loc": ("body", "value"), "msg": "m"} for kind in ("int_type", "float_type")]
    assert of_validation(items).body["errors"] == [{"field": "value", "message": "must be a whole number"}]


def test_what_was_sent_is_not_repeated() -> None:
    item = {"type": "novel", "loc": ("body", "target"), "msg": "is odd", "input": float("nan")}
    body = of_validation([item]).body
    assert body["errors"] == [{"field": "target", "message": "is odd"}]
    assert "nan" not in str(body)


def test_text_that_is_no_json_says_where() -> None:
    item = {"type": "json_invalid", "loc": ("body", 12), "msg": "m", "ctx": {"error": "Expecting value"}}
    assert of_validation([item]).body["detail"] == "body is no JSON: Expecting value at character 12."
    assert re.search("UTF-8", of_unreadable().body["detail"])
