"""The TMCM-3216's profile, read once."""

from __future__ import annotations

import pytest

from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile


@pytest.fixture(scope="session")
def tmcm_3216() -> DeviceProfile:
    return Catalog.load().profile("TMCM-3216")
