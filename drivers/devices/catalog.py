"""The modules that we know, by model and by identity, read from the data files of the package."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable

from drivers.cia402.modes import Mode
from drivers.devices.dictionary import index_objects, read_objects
from drivers.devices.emergencies import read_emergencies
from drivers.devices.layout import AxisLayout
from drivers.devices.meanings import read_meanings
from drivers.devices.profile import DeviceProfile, Identity, ObjectSpec
from drivers.devices.tables import DataError, Table

# Every other file of a module's folder holds objects.
_DEVICE = "device.toml"
_EMERGENCIES = "emergencies.toml"
_MEANINGS = "meanings.toml"


class Catalog:
    """All modules whose data we have. Immutable."""

    def __init__(self, profiles: Iterable[DeviceProfile]) -> None:
        self.profiles = tuple(profiles)
        self._by_model = {profile.model: profile for profile in self.profiles}
        self._by_identity = {(profile.vendor_id, profile.product_code): profile for profile in self.profiles}
        if not len(self.profiles) == len(self._by_model) == len(self._by_identity):
            raise DataError("two modules share a model or an identity")

    @classmethod
    def load(cls) -> Catalog:
        """Every module in ``drivers/devices/data``; a folder each. Raises DataError if a file is wrong."""
        folders = sorted(_data_folder().iterdir(), key=lambda folder: folder.name)
        return cls(load_profile(folder) for folder in folders if folder.joinpath(_DEVICE).is_file())

    @property
    def models(self) -> tuple[str, ...]:
        """The names of all modules."""
        return tuple(self._by_model)

    def profile(self, model: str) -> DeviceProfile:
        """The module of this name. Raises KeyError."""
        return self._by_model[model]

    def identify(self, vendor_id: int, product_code: int) -> DeviceProfile | None:
        """The module with this 1018h:1 and 1018h:2, or None."""
        return self._by_identity.get((vendor_id, product_code))


def load_profile(folder: Traversable) -> DeviceProfile:
    """One module from its folder of TOML files. Raises DataError."""
    try:
        return _read_profile(folder)
    except DataError:
        raise
    except (LookupError, TypeError, ValueError) as error:  # of what is made of the tables' values
        raise DataError(f"{folder.name}: {error}") from error


def _read_profile(folder: Traversable) -> DeviceProfile:
    device = _read(folder.joinpath(_DEVICE)).table("device")
    if device is None:
        raise DataError(f"{folder.name}/{_DEVICE} has no table [device]")
    layout = AxisLayout(device.integer("axes"))
    profile = DeviceProfile(
        model=device.text("model"),
        manual=device.text("manual"),
        edited=device.text("edited"),
        identity=Identity(
            vendor_name=device.text("vendor_name"),
            vendor_id=device.integer("vendor_id"),
            product_code=device.integer("product_code"),
            revision_number=device.integer("revision_number"),
            device_type=device.integer("device_type"),
            device_name=device.text("device_name"),
        ),
        layout=layout,
        objects=index_objects(_all_objects(folder, layout)),
        emergencies=read_emergencies(_read(folder.joinpath(_EMERGENCIES)), layout.axes),
        meanings=read_meanings(_read(folder.joinpath(_MEANINGS))),
        bit_rates=device.integers("bit_rates"),
        homing_methods=frozenset(device.integers("homing_methods")),
        modes=frozenset(map(Mode, device.integers("modes"))),
        features=frozenset(device.texts("features")),
    )
    device.close()
    return profile


def _all_objects(folder: Traversable, layout: AxisLayout) -> Iterator[ObjectSpec]:
    for file in sorted(folder.iterdir(), key=lambda file: file.name):
        if file.name.endswith(".toml") and file.name not in (_DEVICE, _EMERGENCIES, _MEANINGS):
            yield from read_objects(_read(file), layout)


def _read(file: Traversable) -> Table:
    try:
        return Table(tomllib.loads(file.read_text(encoding="utf-8")), file.name)
    except (OSError, ValueError, RecursionError) as error:  # TOML's and UTF-8's errors are ValueErrors
        raise DataError(f"{file.name}: {error}") from error


def _data_folder() -> Traversable:
    return files("drivers.devices").joinpath("data")
