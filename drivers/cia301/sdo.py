"""SDO, all of it under one name: codes (`sdo_codes`), the client's transfers (`sdo_client`), `SdoServer`."""

from __future__ import annotations

from drivers.cia301.sdo_client import (
    Aborted,
    Done,
    Ignored,
    SdoDownload,
    SdoTransfer,
    SdoUpload,
    Send,
    Step,
    Violation,
)
from drivers.cia301.sdo_codes import (
    DEFAULT_MAX_SIZE,
    AbortCode,
    SdoAbort,
    abort_frame,
    abort_meaning,
)
from drivers.cia301.sdo_server import SdoServer

__all__ = [
    "DEFAULT_MAX_SIZE",
    "AbortCode",
    "Aborted",
    "Done",
    "Ignored",
    "SdoAbort",
    "SdoDownload",
    "SdoServer",
    "SdoTransfer",
    "SdoUpload",
    "Send",
    "Step",
    "Violation",
    "abort_frame",
    "abort_meaning",
]
