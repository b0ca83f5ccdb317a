"""The book of leases, by itself: time is an argument."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from app.http.problems import ApiError
from app.leases.book import AxisKey, Lease, LeaseBook, draw

X, Y, Z = (1, 0), (1, 1), (1, 2)
AXES = (X, Y, Z, (2, 0))
CREATED = datetime(2026, 1, 1, tzinfo=UTC)


def lease(*axes: AxisKey, ttl: float = 10, now: float = 0, owner: str = "anna", fencing: int = 1) -> Lease:
    return draw(fencing, owner, "token", axes, ttl, CREATED, now)


def code_of(book: LeaseBook, axes: tuple[AxisKey, ...], token: str | None, now: float = 0) -> str:
    """What a command is refused with; empty if it isn't."""
    try:
        book.check(axes, token, now)
    except ApiError as error:
        return error.type.code
    return ""


def test_an_axis_of_a_lease_takes_the_commands_of_its_holder_alone() -> None:
    book, hers = LeaseBook(), lease(X, Y)
    book.enter(hers, 0)
    assert code_of(book, (X,), None) == "leased"
    assert code_of(book, (Z,), None) == ""
    assert code_of(book, (X, Y), hers.token) == ""
    assert code_of(book, (X, Z), hers.token) == ""
    assert code_of(book, (Z,), "of yesterday") == "lease_lost"


def test_a_refusal_says_who_has_it_and_how_long() -> None:
    book = LeaseBook()
    book.enter(lease(Y), 0)
    with pytest.raises(ApiError) as refused:
        book.check((X, Y), None, 4.5)
    assert refused.value.extra == {"owner": "anna", "expires_in_s": 5.5, "node": 1, "axis": 1}
    assert refused.value.retry_after == 5.5


def test_all_or_nothing() -> None:
    book = LeaseBook()
    book.enter(lease(Y), 0)
    with pytest.raises(ApiError, match="anna"):
        book.enter(lease(X, Y, owner="bert"), 0)
    assert book.of(X) is None
    assert code_of(book, (X,), None) == ""


def test_force_ends_what_is_in_the_way_whole() -> None:
    book, hers, other = LeaseBook(), lease(X, Y), lease(Z)
    book.enter(hers, 0)
    book.enter(other, 0)
    his = lease(Y, owner="bert")
    assert book.enter(his, 1, force=True) == (hers,)
    assert book.of(X) is None
    assert code_of(book, (X,), hers.token) == "lease_lost"
    assert code_of(book, (Y,), his.token) == ""
    assert code_of(book, (Z,), other.token) == ""


def test_it_expires_unless_it_is_renewed() -> None:
    book, hers = LeaseBook(), lease(X)
    book.enter(hers, 0)
    assert book.due(9.9) == ()
    renewed = book.renew(book.held(hers.id, hers.token, 9.9), 3, 9.9)
    assert book.next_end == pytest.approx(12.9)
    assert book.due(12.8) == ()
    assert book.due(12.9) == (renewed,)
    assert book.due(13) == ()
    assert len(book) == 0


@pytest.mark.parametrize(
    ("token", "code"), [(None, "leased"), ("nobody's", "lease_lost"), ("other's", "leased")]
)
def test_only_its_holder_renews_or_releases_it(token: str | None, code: str) -> None:
    book, hers, other = LeaseBook(), lease(X), lease(Y)
    book.enter(hers, 0)
    book.enter(other, 0)
    with pytest.raises(ApiError) as refused:
        book.held(hers.id, other.token if token == "other's" else token, 0)
    assert refused.value.type.code == code
    with pytest.raises(ApiError) as refused:
        book.held("unknown", hers.token, 0)
    assert refused.value.type.code == "lease_lost"


class Book(RuleBasedStateMachine):
    """Clients that take, renew, release and lose leases, beside a list of who may command what."""

    def __init__(self) -> None:
        super().__init__()
        self.book = LeaseBook()
        self.now = 0.0
        self.drawn: list[Lease] = []
        self.held: dict[str, Lease] = {}

    def pick(self, data: st.DataObject) -> Lease | None:
        return data.draw(st.sampled_from(self.drawn)) if self.drawn else None

    @rule(
        axes=st.lists(st.sampled_from(AXES), min_size=1, max_size=5),
        ttl=st.floats(1, 60),
        force=st.booleans(),
    )
    def take(self, axes: list[AxisKey], ttl: float, force: bool) -> None:
        self.expire(0)
        wanted = lease(*axes, ttl=ttl, now=self.now, fencing=len(self.drawn))
        in_the_way = [each for each in self.held.values() if set(each.axes) & set(axes)]
        if in_the_way and not force:
            with pytest.raises(ApiError):
                self.book.enter(wanted, self.now)
            return
        assert {each.id for each in self.book.enter(wanted, self.now, force=force)} == {
            each.id for each in in_the_way
        }
        for each in in_the_way:
            del self.held[each.id]
        self.held[wanted.id] = wanted
        self.drawn.append(wanted)

    @rule(data=st.data(), ttl=st.none() | st.floats(1, 60), release=st.booleans())
    def renew_or_release(self, data: st.DataObject, ttl: float | None, release: bool) -> None:
        self.expire(0)
        chosen = self.pick(data)
        if chosen is None:
            return
        if chosen.id not in self.held:
            with pytest.raises(ApiError):
                self.book.held(chosen.id, chosen.token, self.now)
            return
        found = self.book.held(chosen.id, chosen.token, self.now)
        if release:
            self.book.strike(found)
            del self.held[chosen.id]
        else:
            self.held[chosen.id] = self.book.renew(found, ttl, self.now)

    @rule(seconds=st.floats(0, 40))
    def expire(self, seconds: float) -> None:
        self.now += seconds
        due = {each.id for each in self.book.due(self.now)}
        assert due == {each.id for each in self.held.values() if each.ends <= self.now}
        for each in due:
            del self.held[each]

    @invariant()
    def every_axis_has_one_holder_at_most_and_nobody_else_commands_it(self) -> None:
        assert {each.id for each in self.book.all()} == set(self.held)
        assert self.book.next_end == min((each.ends for each in self.held.values()), default=None)
        for axis in AXES:
            holders = [each for each in self.held.values() if axis in each.axes]
            assert len(holders) <= 1
            assert code_of(self.book, (axis,), None, self.now) == ("leased" if holders else "")
            for each in self.drawn:
                expected = "lease_lost" if each.id not in self.held else ""
                if not expected and holders and holders[0].id != each.id:
                    expected = "leased"
                assert code_of(self.book, (axis,), each.token, self.now) == expected


Book.TestCase.settings = settings(max_examples=40, stateful_step_count=25, deadline=None)
TestBook = Book.TestCase
