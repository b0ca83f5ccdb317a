"""THE table: every error of the drivers has a row, and every row a status and a way out."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from app.http.problems import (
    PROBLEM_TYPES,
    ApiError,
    ProblemReply,
    ProblemType,
    of_api_error,
    of_driver_error,
    of_status,
    problem,
)
from app.http.replies import problem_response
from drivers import errors


def classes(root: type[errors.CanaxisError]) -> Iterator[type[errors.CanaxisError]]:
    yield root
    for kind in root.__subclasses__():
        yield from classes(kind)


@pytest.mark.parametrize(
    "kind", [kind for kind in classes(errors.CanaxisError) if kind.__module__ == "drivers.errors"]
)
def test_every_driver_error_has_a_row_of_its_own(kind: type[errors.CanaxisError]) -> None:
    assert kind.code in PROBLEM_TYPES


@pytest.mark.parametrize("row", PROBLEM_TYPES.values(), ids=PROBLEM_TYPES)
def test_every_row_says_what_to_do(row: ProblemType) -> None:
    _, status, title, explanation, wait = row
    assert 400 <= status <= 599
    assert wait is None or status in (409, 423, 429, 503), "waiting helps against what passes by itself"
    assert title
    assert explanation.endswith(".")


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (errors.UnknownNode("x"), 404),
        (errors.UnknownAxis("x"), 404),
        (errors.NotReady("x", obstacles=()), 409),
        (errors.AxisBusy("x", obstacles=()), 409),
        (errors.StopLatched("x", obstacles=()), 409),
        (errors.BadValue("x"), 422),
        (errors.SdoAborted("x", abort_code=0x06010000, meaning="m"), 502),
        (errors.BusDown("x"), 503),
        (errors.NodeAway("x"), 503),
        (errors.SdoTimeout("x"), 504),
        (errors.TransitionTimeout("x"), 504),
    ],
)
def test_the_status_of_the_common_errors(error: errors.CanaxisError, status: int) -> None:
    reply = of_driver_error(error)
    assert reply.status == reply.body["status"] == status
    assert reply.body["type"] == "/problems/" + error.code.replace("_", "-")
    assert reply.body["hint"]


@pytest.mark.parametrize(
    ("reply", "seconds"),
    [
        (of_driver_error(errors.NodeAway("x")), "5"),
        (of_driver_error(errors.SdoQueueFull("x")), "1"),
        (of_driver_error(errors.WrongIdentity("x")), None),
        (of_driver_error(errors.AxisBusy("x", obstacles=())), None),
        (of_api_error(ApiError("leased", "x", retry_after=7.2)), "8"),
        (of_api_error(ApiError("leased", "x", retry_after=0.0)), "1"),
        (of_api_error(ApiError("lease_lost", "x")), None),
        (problem("too_many_requests", "x"), "1"),
    ],
)
def test_a_reply_says_when_to_try_again_where_waiting_helps(reply: ProblemReply, seconds: str | None) -> None:
    assert problem_response(reply).headers.get("retry-after") == seconds


def test_an_abort_carries_where_and_why() -> None:
    error = errors.SdoAborted(
        "refused", abort_code=0x06090031, meaning="too high", node=1, axis=2, index=0x6081, sub=0
    )
    body = of_driver_error(error).body
    assert body["abort_code"] == "0x06090031"
    assert body["abort_meaning"] == "too high"
    assert (body["node"], body["axis"], body["index"], body["sub"]) == (1, 2, "0x6081", 0)


def test_obstacles_are_listed_and_the_hint_is_their_remedies() -> None:
    obstacle = errors.Obstacle("not_enabled", "It is off.", "Enable the axis.", errors.Remedy.ENABLE)
    body = of_driver_error(errors.NotReady("no", obstacles=(obstacle,), node=3, axis=1)).body
    action = {"method": "POST", "path": "/api/v1/nodes/3/axes/1/enable", "body": {}}
    told = {"code": "not_enabled", "message": "It is off.", "remedy": "Enable the axis.", "action": action}
    assert body["obstacles"] == [told]
    assert body["hint"] == "Enable the axis."


def test_a_new_error_takes_the_row_of_its_base() -> None:
    class Novel(errors.NodeAway):
        code = "novel"

    assert of_driver_error(Novel("x")).status == 503


def test_statuses_of_the_framework() -> None:
    assert of_status(404, "x").body["code"] == "unknown_path"
    assert of_status(418, "x").body["type"] == "about:blank"
