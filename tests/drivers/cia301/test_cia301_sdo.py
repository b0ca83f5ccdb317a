"""SDO: golden frames of the client and the server, and what each does when the other breaks the rules."""

from __future__ import annotations

import pytest

from drivers.cia301.objects import Address
from drivers.cia301.sdo import (
    AbortCode,
    Aborted,
    Done,
    Ignored,
    SdoAbort,
    SdoDownload,
    SdoServer,
    SdoTransfer,
    SdoUpload,
    Send,
    Violation,
    abort_frame,
    abort_meaning,
)

STATUSWORD = Address(0x6041)
NAME = Address(0x1008)
TARGET = Address(0x607A)


def hx(text: str) -> bytes:
    return bytes.fromhex(text)


# --- the client ---


@pytest.mark.parametrize(
    ("answer", "data"),
    [
        ("4F 41 60 00 37 00 00 00", "37"),
        ("4B 41 60 00 37 06 00 00", "37 06"),
        ("47 41 60 00 37 06 01 00", "37 06 01"),
        ("43 41 60 00 37 06 01 02", "37 06 01 02"),
    ],
)
def test_an_expedited_upload(answer: str, data: str) -> None:
    transfer = SdoUpload(STATUSWORD)
    assert transfer.request() == hx("40 41 60 00 00 00 00 00")
    assert transfer.feed(hx(answer)) == Done(hx(data))
    assert transfer.finished


def test_an_expedited_upload_without_a_size_gives_four_bytes_and_says_so() -> None:
    assert SdoUpload(STATUSWORD).feed(hx("42 41 60 00 37 06 00 00")) == Done(
        hx("37 06 00 00"), size_indicated=False
    )


def test_a_segmented_upload_of_the_device_name() -> None:
    transfer = SdoUpload(NAME)
    assert transfer.request() == hx("40 08 10 00 00 00 00 00")
    assert transfer.feed(hx("41 08 10 00 09 00 00 00")) == Send(hx("60 00 00 00 00 00 00 00"))
    assert transfer.feed(hx("00 54 4D 43 4D 2D 33 32")) == Send(hx("70 00 00 00 00 00 00 00"))
    assert transfer.feed(hx("1B 31 36 00 00 00 00 00")) == Done(b"TMCM-3216")


def test_a_segmented_upload_without_a_size() -> None:
    transfer = SdoUpload(NAME)
    assert isinstance(transfer.feed(hx("40 08 10 00 00 00 00 00")), Send)
    assert transfer.feed(hx("0B 31 36 00 00 00 00 00")) == Done(b"16")


@pytest.mark.parametrize(
    ("data", "request_frame"),
    [
        ("06", "2F 7A 60 00 06 00 00 00"),
        ("1F 00", "2B 7A 60 00 1F 00 00 00"),
        ("01 02 03", "27 7A 60 00 01 02 03 00"),
        ("20 A1 07 00", "23 7A 60 00 20 A1 07 00"),  # the 500000 of manual §6.2
    ],
)
def test_an_expedited_download(data: str, request_frame: str) -> None:
    transfer = SdoDownload(TARGET, hx(data))
    assert transfer.request() == hx(request_frame)
    assert transfer.feed(hx("60 7A 60 00 00 00 00 00")) == Done()


def test_a_segmented_download() -> None:
    transfer = SdoDownload(NAME, b"TMCM-3216")
    assert transfer.request() == hx("21 08 10 00 09 00 00 00")
    assert transfer.feed(hx("60 08 10 00 00 00 00 00")) == Send(hx("00 54 4D 43 4D 2D 33 32"))
    assert transfer.feed(hx("20 00 00 00 00 00 00 00")) == Send(hx("1B 31 36 00 00 00 00 00"))
    assert transfer.feed(hx("30 00 00 00 00 00 00 00")) == Done()


def test_a_download_of_nothing_is_one_empty_segment() -> None:
    transfer = SdoDownload(NAME, b"")
    assert transfer.request() == hx("21 08 10 00 00 00 00 00")
    assert transfer.feed(hx("60 08 10 00 00 00 00 00")) == Send(hx("0F 00 00 00 00 00 00 00"))
    assert transfer.feed(hx("20 00 00 00 00 00 00 00")) == Done()


def test_a_refusal_carries_its_code() -> None:
    transfer = SdoDownload(TARGET, b"\0\0\0\0")
    assert transfer.feed(hx("80 7A 60 00 22 00 00 08")) == Aborted(0x08000022)
    assert isinstance(transfer.feed(hx("60 7A 60 00 00 00 00 00")), Ignored)


def test_giving_up_sends_an_abort_of_the_transfer() -> None:
    assert SdoUpload(STATUSWORD).abort_frame() == hx("80 41 60 00 00 00 04 05")
    assert SdoUpload(Address(0x607D, 2)).abort_frame(0x08000000) == hx("80 7D 60 02 00 00 00 08")


@pytest.mark.parametrize(
    "late",
    [
        "4B 40 60 00 06 00 00 00",  # another index
        "4B 41 60 01 06 00 00 00",  # another sub-index
        "4B 41 68 00 06 00 00 00",  # another axis
        "60 41 60 00 00 00 00 00",  # a download's answer, about our object
        "80 40 60 00 00 00 02 06",  # the refusal of another object
        "C0 40 60 00 00 00 00 00",  # a block answer about another object
        "03 41 60 00 00 00 00 00",  # a segment, while none is awaited
        "20 00 00 00 00 00 00 00",
        "4B 41 60 00 37 06 00",  # seven bytes
        "",
    ],
)
def test_what_is_not_the_answer_is_dropped_and_the_answer_still_taken(late: str) -> None:
    transfer = SdoUpload(STATUSWORD)
    assert isinstance(transfer.feed(hx(late)), Ignored)
    assert not transfer.finished
    assert transfer.feed(hx("4B 41 60 00 37 06 00 00")) == Done(hx("37 06"))


def test_a_download_does_not_take_an_uploads_answer_for_its_own() -> None:
    transfer = SdoDownload(STATUSWORD, b"\x06\x00")
    assert isinstance(transfer.feed(hx("4B 41 60 00 37 06 00 00")), Ignored)
    assert transfer.feed(hx("60 41 60 00 00 00 00 00")) == Done()


def test_amid_segments_only_the_awaited_kind_of_segment_is_taken() -> None:
    upload = SdoUpload(NAME)
    upload.feed(hx("41 08 10 00 09 00 00 00"))
    for foreign in ("41 08 10 00 09 00 00 00", "20 00 00 00 00 00 00 00", "4B 41 60 00 37 06 00 00"):
        assert isinstance(upload.feed(hx(foreign)), Ignored)
    assert isinstance(upload.feed(hx("00 54 4D 43 4D 2D 33 32")), Send)


def test_an_abort_amid_segments_ends_the_transfer() -> None:
    upload = SdoUpload(NAME)
    upload.feed(hx("41 08 10 00 09 00 00 00"))
    assert upload.feed(hx("80 08 10 00 00 00 04 05")) == Aborted(AbortCode.TIMED_OUT)


def violated(transfer: SdoTransfer, *frames: str) -> bytes:
    """The abort with which the last of the frames is met."""
    *before, last = frames
    for frame in before:
        assert isinstance(transfer.feed(hx(frame)), Send)
    step = transfer.feed(hx(last))
    assert isinstance(step, Violation)
    assert transfer.finished
    assert str(transfer.address) in step.reason
    return step.abort


def test_a_wrong_toggle_is_a_violation_in_both_directions() -> None:
    upload = violated(SdoUpload(NAME), "41 08 10 00 09 00 00 00", "10 54 4D 43 4D 2D 33 32")
    assert upload == hx("80 08 10 00 00 00 03 05")
    repeated = violated(
        SdoUpload(NAME), "41 08 10 00 09 00 00 00", "00 54 4D 43 4D 2D 33 32", "00 54 4D 43 4D 2D 33 32"
    )
    assert repeated == hx("80 08 10 00 00 00 03 05")
    download = violated(SdoDownload(NAME, bytes(9)), "60 08 10 00 00 00 00 00", "30 00 00 00 00 00 00 00")
    assert download == hx("80 08 10 00 00 00 03 05")


@pytest.mark.parametrize("byte", ["A0", "C0", "E0"])
def test_an_answer_about_our_object_that_no_request_asks_for_is_a_violation(byte: str) -> None:
    assert violated(SdoUpload(NAME), f"{byte} 08 10 00 00 00 00 00") == hx("80 08 10 00 01 00 04 05")


def test_an_upload_must_be_as_long_as_announced() -> None:
    too_short = violated(SdoUpload(NAME), "41 08 10 00 09 00 00 00", "01 54 4D 43 4D 2D 33 32")
    assert too_short == hx("80 08 10 00 10 00 07 06")
    too_long = violated(SdoUpload(NAME), "41 08 10 00 05 00 00 00", "01 54 4D 43 4D 2D 33 32")
    assert too_long == hx("80 08 10 00 10 00 07 06")


def test_an_upload_is_bounded() -> None:
    announced = violated(SdoUpload(NAME, max_size=8), "41 08 10 00 09 00 00 00")
    assert announced == hx("80 08 10 00 05 00 04 05")
    unannounced = violated(
        SdoUpload(NAME, max_size=8),
        "40 08 10 00 00 00 00 00",
        "00 01 02 03 04 05 06 07",
        "10 01 02 03 04 05 06 07",
    )
    assert unannounced == hx("80 08 10 00 05 00 04 05")
    assert violated(SdoUpload(NAME), "41 08 10 00 01 00 01 00") == hx("80 08 10 00 05 00 04 05")


def test_a_server_that_sends_empty_segments_for_ever_is_stopped() -> None:
    abort = violated(SdoUpload(NAME), "40 08 10 00 00 00 00 00", "0E 00 00 00 00 00 00 00")
    assert abort == hx("80 08 10 00 10 00 07 06")


# --- the words ---


def test_each_abort_code_has_words_of_its_own() -> None:
    meanings = {abort_meaning(code) for code in AbortCode}
    assert len(meanings) == len(AbortCode) == 31
    assert not any("unknown abort code" in meaning for meaning in meanings)


def test_an_unknown_abort_code_has_words_too() -> None:
    assert "0604FFFFh" in abort_meaning(0x0604FFFF)
    assert "06020000h: there is no such object" in str(SdoAbort(AbortCode.NO_SUCH_OBJECT))


# --- the server ---


class Dictionary:
    """Three objects: a word, a name, and one that is not there."""

    def __init__(self) -> None:
        self.values = {STATUSWORD: hx("37 06"), NAME: b"TMCM-3216", TARGET: bytes(4)}
        self.writes: list[tuple[Address, bytes]] = []

    def read(self, address: Address) -> bytes:
        if address not in self.values:
            raise SdoAbort(AbortCode.NO_SUCH_OBJECT)
        return self.values[address]

    def write(self, address: Address, data: bytes) -> None:
        if address == STATUSWORD:
            raise SdoAbort(AbortCode.READ_ONLY)
        self.read(address)
        self.writes.append((address, data))

    def size_of(self, address: Address) -> int | None:
        return {STATUSWORD: 2, TARGET: 4, Address(0x6060): 1}.get(address)

    def server(self) -> SdoServer:
        return SdoServer(self.read, self.write, self.size_of)


@pytest.fixture
def dictionary() -> Dictionary:
    return Dictionary()


@pytest.fixture
def server(dictionary: Dictionary) -> SdoServer:
    return dictionary.server()


@pytest.mark.parametrize(
    "dialogue",
    [
        # expedited upload, and one of an object that is not there
        [("40 41 60 00 00 00 00 00", "4B 41 60 00 37 06 00 00")],
        [("40 42 60 05 00 00 00 00", "80 42 60 05 00 00 02 06")],
        # segmented upload
        [
            ("40 08 10 00 00 00 00 00", "41 08 10 00 09 00 00 00"),
            ("60 00 00 00 00 00 00 00", "00 54 4D 43 4D 2D 33 32"),
            ("70 00 00 00 00 00 00 00", "1B 31 36 00 00 00 00 00"),
        ],
        # expedited download, and one that is refused
        [("23 7A 60 00 20 A1 07 00", "60 7A 60 00 00 00 00 00")],
        [("2B 41 60 00 00 00 00 00", "80 41 60 00 02 00 01 06")],
        # segmented download
        [
            ("21 08 10 00 08 00 00 00", "60 08 10 00 00 00 00 00"),
            ("00 61 62 63 64 65 66 67", "20 00 00 00 00 00 00 00"),
            ("1D 68 00 00 00 00 00 00", "30 00 00 00 00 00 00 00"),
        ],
        # a segment without a transfer, block transfer, and what is no command
        [("60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05")],
        [("00 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05")],
        [("C2 08 10 00 09 00 00 00", "80 08 10 00 01 00 04 05")],
        [("A0 08 10 00 7F 00 00 00", "80 08 10 00 01 00 04 05")],
        [("E0 08 10 00 00 00 00 00", "80 08 10 00 01 00 04 05")],
        # wrong toggles, after which the transfer is gone
        [
            ("40 08 10 00 00 00 00 00", "41 08 10 00 09 00 00 00"),
            ("70 00 00 00 00 00 00 00", "80 08 10 00 00 00 03 05"),
            ("60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
        ],
        [
            ("21 08 10 00 08 00 00 00", "60 08 10 00 00 00 00 00"),
            ("10 61 62 63 64 65 66 67", "80 08 10 00 00 00 03 05"),
        ],
        # more and less than announced, and more than can be held
        [
            ("21 08 10 00 05 00 00 00", "60 08 10 00 00 00 00 00"),
            ("01 61 62 63 64 65 66 67", "80 08 10 00 12 00 07 06"),
        ],
        [
            ("21 08 10 00 09 00 00 00", "60 08 10 00 00 00 00 00"),
            ("01 61 62 63 64 65 66 67", "80 08 10 00 13 00 07 06"),
        ],
        [("21 08 10 00 01 00 01 00", "80 08 10 00 05 00 04 05")],
        # the other direction's segment
        [
            ("21 08 10 00 08 00 00 00", "60 08 10 00 00 00 00 00"),
            ("60 00 00 00 00 00 00 00", "80 08 10 00 01 00 04 05"),
        ],
    ],
)
def test_a_server_answers(server: SdoServer, dialogue: list[tuple[str, str]]) -> None:
    for request, response in dialogue:
        answer = server.feed(hx(request))
        assert answer is not None
        assert answer.hex(" ").upper() == response


def test_a_write_reaches_the_object_once_and_whole(server: SdoServer, dictionary: Dictionary) -> None:
    server.feed(hx("21 08 10 00 08 00 00 00"))
    server.feed(hx("00 61 62 63 64 65 66 67"))
    assert dictionary.writes == []
    assert server.busy
    server.feed(hx("1D 68 00 00 00 00 00 00"))
    assert dictionary.writes == [(NAME, b"abcdefgh")]
    assert not server.busy


def test_a_download_without_a_size_is_cut_to_the_object(dictionary: Dictionary) -> None:
    dictionary.values[Address(0x6060)] = b"\0"
    assert dictionary.server().feed(hx("22 60 60 00 06 00 00 00")) == hx("60 60 60 00 00 00 00 00")
    unsized = SdoServer(dictionary.read, dictionary.write)
    assert unsized.feed(hx("22 60 60 00 06 00 00 00")) == hx("60 60 60 00 00 00 00 00")
    assert dictionary.writes == [(Address(0x6060), b"\x06"), (Address(0x6060), b"\x06\0\0\0")]


def test_a_new_transfer_ends_the_old_one(server: SdoServer, dictionary: Dictionary) -> None:
    server.feed(hx("21 08 10 00 08 00 00 00"))
    server.feed(hx("00 61 62 63 64 65 66 67"))
    assert server.feed(hx("40 41 60 00 00 00 00 00")) == hx("4B 41 60 00 37 06 00 00")
    assert server.feed(hx("1D 68 00 00 00 00 00 00")) == abort_frame(Address(0), AbortCode.UNKNOWN_COMMAND)
    assert dictionary.writes == []


def test_an_abort_ends_the_transfer_without_an_answer(server: SdoServer, dictionary: Dictionary) -> None:
    server.feed(hx("21 08 10 00 08 00 00 00"))
    assert server.feed(hx("80 08 10 00 00 00 04 05")) is None
    assert not server.busy
    assert dictionary.writes == []


def test_a_reset_forgets_the_transfer(server: SdoServer) -> None:
    server.feed(hx("40 08 10 00 00 00 00 00"))
    server.reset()
    assert server.feed(hx("60 00 00 00 00 00 00 00")) == hx("80 00 00 00 01 00 04 05")


@pytest.mark.parametrize("wire", ["", "40 41 60 00", "40 41 60 00 00 00 00 00 00"])
def test_a_frame_of_another_length_is_not_answered(server: SdoServer, wire: str) -> None:
    assert server.feed(hx(wire)) is None


def test_a_download_without_a_size_is_bounded_too(dictionary: Dictionary) -> None:
    server = SdoServer(dictionary.read, dictionary.write, max_size=8)
    server.feed(hx("20 08 10 00 00 00 00 00"))
    server.feed(hx("00 61 62 63 64 65 66 67"))
    assert server.feed(hx("10 61 62 63 64 65 66 67")) == hx("80 08 10 00 05 00 04 05")
    assert dictionary.writes == []
