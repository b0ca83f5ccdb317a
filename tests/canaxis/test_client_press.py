"""What a jog says to the service, and when, on times of a clock that nobody waits for."""

from __future__ import annotations

import json
from typing import Any

import pytest

from canaxis import BadReply, JogStopped, NotReady, OperationCancelled, ServiceUnreachable, WaitTimeout
from canaxis.contract.press import Press


def said(kind: str, **more: object) -> str:
    return json.dumps({"kind": kind, "stamp": 7.0, **more})


def stopped(reason: str) -> str:
    return said("stopped", reason=reason, detail="So.", hint="", operation=None, result=None)


REFUSED = said("problem", problem={"code": "not_ready", "status": 409, "detail": "Not enabled."})


@pytest.fixture
def press() -> Press:
    press = Press()
    press.greet(said("hello", keep_alive_ms=100), now=10.0)
    return press


def hold(press: Press, now: float) -> dict[str, Any]:
    return json.loads(press.hold(2.0, "mm", None, now))


def test_a_hold_is_said_again_each_time_that_it_is_due_and_not_before(press: Press) -> None:
    assert hold(press, 20.0) == {
        "kind": "hold", "seq": 1, "sent": 20_000, "echo": 7.0, "echo_age_ms": 10_000,
        "velocity": 2.0, "unit": "mm",
    }  # fmt: skip
    assert press.due(20.09) is None
    assert press.pause(20.09) == pytest.approx(0.01)
    again = press.due(20.1)
    assert again is not None
    assert json.loads(again)["seq"] == 2
    assert press.pause(25.0) == 0.0, "late, but no negative time"


@pytest.mark.parametrize("end", ["release", "stopped", "problem", "close"])
def test_whatever_ends_a_press_nothing_says_any_more_that_it_is_held(press: Press, end: str) -> None:
    hold(press, 20.0)
    match end:
        case "release":
            assert json.loads(press.release()) == {"kind": "release"}
        case "close":
            press.close()
        case _:
            press.hear(stopped("silence") if end == "stopped" else REFUSED, 20.01)
    assert not press.held
    assert press.due(30.0) is None
    assert press.pause(30.0) == pytest.approx(0.1), "the service is heard all the same"


def test_a_release_waits_for_the_end_of_its_press_also_when_it_is_asked_twice(press: Press) -> None:
    press.release()
    assert press.settled, "nothing was held"
    assert press.ended() is None
    hold(press, 20.0)
    for _ in range(2):
        press.release()
        assert not press.settled
        with pytest.raises(WaitTimeout):
            press.ended()
    press.hear(stopped("released"), 21.0)
    assert press.settled
    assert press.ended() == JogStopped("released", "So.", "", None, None)


def test_what_ended_a_press_is_raised_until_it_was_released(press: Press) -> None:
    hold(press, 20.0)
    press.hear(stopped("limit"), 20.1)
    for _ in range(2):
        with pytest.raises(OperationCancelled) as cancelled:
            hold(press, 20.2)
        assert cancelled.value.code == "limit"
    press.release()
    assert (ended := press.ended()) is not None
    assert ended.reason == "limit"
    assert hold(press, 20.3)["seq"] == 2


def test_a_refusal_is_raised_until_it_was_released(press: Press) -> None:
    hold(press, 20.0)
    press.hear(REFUSED, 20.1)
    for _ in range(2):
        with pytest.raises(NotReady):
            hold(press, 20.2)
    press.release()
    with pytest.raises(NotReady):
        press.ended()
    hold(press, 20.3)


def test_before_it_is_open_and_after_its_end_there_is_nothing_to_hold(press: Press) -> None:
    for closed in (Press(), press):
        closed.close()
        with pytest.raises(ServiceUnreachable, match="closed"):
            hold(closed, 20.0)


def test_a_service_that_refuses_instead_of_greeting_says_why() -> None:
    with pytest.raises(NotReady):
        Press().greet(REFUSED, 10.0)
    for nonsense in ("<h1>", "[]", said("hello")):
        with pytest.raises(BadReply):
            Press().greet(nonsense, 10.0)
