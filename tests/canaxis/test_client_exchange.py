"""What is sent again, what never is, and what is said in the end: on scripted answers."""

from __future__ import annotations

import json
from collections.abc import Callable

import httpx
import pytest

from canaxis import (
    BadReply,
    BadValue,
    CanaxisError,
    Client,
    Conflict,
    KeyInFlight,
    OutcomeUnknown,
    Patience,
    ServiceUnreachable,
    Unauthorized,
    Unavailable,
    UnknownNode,
)
from canaxis.contract.exchange import Request, asking
from canaxis.replies import AxisStatus, StopState

URL = "http://service.example:8402"
LATCH = {"latched": False, "reason": None, "time": None, "since_a_newer_version": 1}
Script = httpx.Response | type[httpx.TransportError]


def problem(status: int, code: str, **more: object) -> httpx.Response:
    return httpx.Response(status, json={"code": code, "status": status, "detail": "It is so.", **more})


class Scripted:
    """A client whose service answers by a script, the last line over and over; pauses take no time."""

    def __init__(self, *script: Script, patience: Patience | None = None, token: str | None = None) -> None:
        self.sent: list[httpx.Request] = []
        self.pauses: list[float] = []
        self._script = list(script)
        transport = httpx.MockTransport(self._answer)
        self.client = Client(
            URL,
            token=token,
            patience=patience,
            http=httpx.Client(transport=transport),
            sleep=self.pauses.append,
        )

    def _answer(self, request: httpx.Request) -> httpx.Response:
        self.sent.append(request)
        answer = self._script.pop(0) if len(self._script) > 1 else self._script[0]
        if isinstance(answer, httpx.Response):
            return answer
        raise answer("scripted", request=request)

    @property
    def keys(self) -> list[str | None]:
        """The key of each request."""
        return [request.headers.get("Idempotency-Key") for request in self.sent]


@pytest.mark.parametrize(
    "trouble",
    [
        httpx.ConnectError,
        httpx.ReadError,
        httpx.ReadTimeout,
        httpx.RemoteProtocolError,
        httpx.Response(502, text="<h1>Bad gateway</h1>"),
        httpx.Response(503, json={"message": "no healthy upstream"}),
        httpx.Response(504),
        problem(409, "key_in_flight"),
        problem(429, "too_many_requests"),
    ],
)
def test_a_command_is_sent_again_as_it_was_with_its_key(trouble: Script) -> None:
    scripted = Scripted(trouble, trouble, httpx.Response(200, json=LATCH))
    assert scripted.client.reset_stop().latched is False
    assert len(scripted.sent) == 3
    assert len(set(scripted.keys)) == 1
    assert scripted.keys[0]
    assert len({(r.method, r.url, r.content, r.headers["content-type"]) for r in scripted.sent}) == 1
    assert scripted.pauses == [0.1, 0.2]


def test_each_command_has_a_key_of_its_own() -> None:
    scripted = Scripted(httpx.Response(200, json=LATCH), token="secret")
    scripted.client.reset_stop()
    scripted.client.reset_stop()
    assert len(set(scripted.keys)) == 2
    assert scripted.sent[0].headers["authorization"] == "Bearer secret"


@pytest.mark.parametrize(
    "refusal", [problem(409, "not_ready"), problem(503, "sdo_queue_full"), problem(504, "sdo_timeout")]
)
def test_what_the_service_itself_says_is_not_asked_again(refusal: httpx.Response) -> None:
    scripted = Scripted(refusal)
    with pytest.raises(CanaxisError) as refused:
        scripted.client.reset_stop()
    assert refused.value.status == refusal.status_code
    assert len(scripted.sent) == 1


@pytest.mark.parametrize(
    ("trouble", "kind"),
    [
        (httpx.ConnectError, ServiceUnreachable),
        (httpx.ReadTimeout, OutcomeUnknown),
        (httpx.Response(504), OutcomeUnknown),
        (problem(409, "key_in_flight"), KeyInFlight),
    ],
)
def test_it_gives_up_once_its_patience_is_at_an_end(trouble: Script, kind: type[Exception]) -> None:
    scripted = Scripted(trouble, patience=Patience(total=1.0, first=0.3, longest=0.5))
    with pytest.raises(kind) as gone:
        scripted.client.reset_stop()
    assert type(gone.value) is kind
    assert scripted.pauses == pytest.approx([0.3, 0.5, 0.2])
    assert len(set(scripted.keys)) == 1


def test_a_command_that_got_through_once_has_an_unknown_outcome_though_nobody_answers_any_more() -> None:
    scripted = Scripted(httpx.ReadError, httpx.ConnectError, patience=Patience(total=0.5))
    with pytest.raises(OutcomeUnknown, match="status"):
        scripted.client.reset_stop()


def test_without_a_key_nothing_but_a_read_or_a_stop_is_sent_twice() -> None:
    scripted = Scripted(httpx.ReadError)
    bare = asking(Request("POST", "/api/v1/stop/reset", body={}), StopState)
    with pytest.raises(OutcomeUnknown):
        scripted.client.run(bare)
    assert len(scripted.sent) == 1
    assert scripted.pauses == []


@pytest.mark.parametrize("total", [0.7, 1.0, 3.3, 15.0])
def test_the_pauses_come_to_their_sum_and_none_of_them_is_nothing(total: float) -> None:
    pauses = list(Patience(total=total).pauses())
    assert sum(pauses) == pytest.approx(total)
    assert min(pauses) > 1e-6
    assert max(pauses) <= 2.0
    with pytest.raises(ValueError, match="above 0"):
        Patience(first=0)


def test_no_patience_repeats_nothing() -> None:
    scripted = Scripted(httpx.ReadError, patience=Patience(0))
    with pytest.raises(OutcomeUnknown):
        scripted.client.reset_stop()
    assert len(scripted.sent) == 1


@pytest.mark.parametrize(
    "stop",
    [
        lambda client: client.stop_all("Now."),
        lambda client: client.node(1).axis(0).stop(),
        lambda client: client.node(1).axis(0).quick_stop(),
    ],
)
def test_a_stop_is_repeated_without_a_key(stop: Callable[[Client], object]) -> None:
    scripted = Scripted(httpx.ReadError, httpx.ReadTimeout, problem(401, "unauthorized"))
    with pytest.raises(Unauthorized):
        stop(scripted.client)
    assert scripted.keys == [None, None, None]


def test_the_pause_that_a_proxy_asks_for_is_kept_within_bounds() -> None:
    busy = [httpx.Response(503, headers={"Retry-After": seconds}) for seconds in ("1", "3600", "soon")]
    scripted = Scripted(*busy, httpx.Response(200, json=LATCH))
    scripted.client.stop_state()
    assert scripted.pauses == [1.0, 2.0, 0.4]


def test_a_read_waits_longer_where_the_service_is_asked_to_wait() -> None:
    assert Request("GET", "/", waits=20).timeout(30) == httpx.Timeout(50, connect=5)


@pytest.mark.parametrize(
    "answer",
    [
        httpx.Response(200, text="hello"),
        httpx.Response(200, json=[]),
        httpx.Response(200, json={"latched": 1, "reason": None, "time": None}),
        httpx.Response(200, json={"latched": True, "reason": None, "time": "noon"}),
        httpx.Response(200, json={"latched": True, "reason": None}),
        httpx.Response(404, text="<h1>nginx</h1>"),
        httpx.Response(302, headers={"Location": "/login"}),
    ],
)
def test_an_answer_that_is_none_of_canaxis_says_so(answer: httpx.Response) -> None:
    scripted = Scripted(answer)
    with pytest.raises(BadReply, match="Canaxis service"):
        scripted.client.stop_state()
    assert len(scripted.sent) == 1


def test_a_code_that_is_newer_than_the_client_is_the_class_of_its_status() -> None:
    with pytest.raises(Unavailable) as error:
        Scripted(problem(503, "moon_in_the_way", hint="Wait a month.", moon="full")).client.reset_stop()
    assert type(error.value) is Unavailable
    assert (error.value.code, error.value.hint, error.value.problem["moon"]) == (
        "moon_in_the_way",
        "Wait a month.",
        "full",
    )
    assert str(error.value) == "It is so. Wait a month."


def test_names_are_quoted_in_paths_and_what_is_none_is_refused_at_once() -> None:
    scripted = Scripted(problem(404, "unknown_node"))
    with pytest.raises(UnknownNode, match="It is so"):
        scripted.client.node("a/b?").axis("ü").status()
    assert scripted.sent[0].url.raw_path == b"/api/v1/nodes/a%2Fb%3F/axes/%C3%BC"
    for name in ("", ".", ".."):
        with pytest.raises(BadValue, match="no name"):
            scripted.client.node(name)


def test_the_options_of_a_move_go_into_its_body_and_its_key_into_the_head() -> None:
    scripted = Scripted(problem(409, "not_ready"))
    with pytest.raises(Conflict):
        scripted.client.node(1).axis(0).move(3, "mm", relative=True, velocity=2, key="mine")
    assert json.loads(scripted.sent[0].content) == {
        "target": 3, "unit": "mm", "relative": True, "velocity": 2
    }  # fmt: skip
    assert scripted.keys == ["mine"]


def test_no_environment_variable_turns_requests_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    with Client(URL) as client:
        assert client._http.trust_env is False


def test_an_axis_status_is_read_with_what_it_lacks_named() -> None:
    with pytest.raises(BadReply, match=r"AxisStatus\.node"):
        Scripted(httpx.Response(200, json={})).client.run(asking(Request("GET", "/"), AxisStatus))
