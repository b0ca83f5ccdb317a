"""The settings of 1005h-1029h that act at once: SYNC, EMCY, heartbeats, error behavior (manual §3.1)."""

from __future__ import annotations

from typing import Final

from drivers.cia301.cob import MAX_COB_ID, is_restricted
from drivers.cia301.objects import Address
from drivers.cia301.sdo import AbortCode
from drivers.sim import emergency
from drivers.sim.dictionary import ObjectDictionary
from drivers.sim.emergency import EmergencyProducer
from drivers.sim.guarding import ErrorBehavior, HeartbeatConsumer, HeartbeatProducer, Reaction

ERROR_REGISTER: Final = Address(0x1001)
SYNC_COB_ID: Final = Address(0x1005)
EMCY_COB_ID: Final = Address(0x1014)
EMCY_INHIBIT_TIME: Final = Address(0x1015)
CONSUMER_HEARTBEAT: Final = Address(0x1016, 1)
PRODUCER_HEARTBEAT: Final = Address(0x1017)
ERROR_BEHAVIOR: Final = 0x1029
COMMUNICATION_ERROR: Final = Address(ERROR_BEHAVIOR, 1)
APPLICATION_ERROR: Final = Address(ERROR_BEHAVIOR, 2)

_CONSUMER_RESERVED: Final = 0xFF000000


class Communication:
    """Heartbeat producer and consumer and EMCY producer, set by their objects; a `Watcher`.

    The generate bit of 1005h is refused: there is no 1006h to give it a period. Unverified on hardware.
    """

    def __init__(
        self, dictionary: ObjectDictionary, emergencies: EmergencyProducer, behavior: ErrorBehavior
    ) -> None:
        self._dictionary = dictionary
        self._emergencies = emergencies
        self._behavior = behavior
        self.producer = HeartbeatProducer()
        self.consumer = HeartbeatConsumer()
        dictionary.attach_live(ERROR_REGISTER, lambda: emergencies.register)
        watched = (SYNC_COB_ID, EMCY_COB_ID, EMCY_INHIBIT_TIME, CONSUMER_HEARTBEAT, PRODUCER_HEARTBEAT)
        dictionary.watch([ERROR_BEHAVIOR, *(address.index for address in watched)], self)

    @property
    def sync_cob_id(self) -> int:
        """Where SYNC is expected."""
        return self._dictionary.stored(SYNC_COB_ID) & MAX_COB_ID

    def reaction(self, error_class: Address) -> Reaction:
        """What 1029h asks for on an error of this class (`COMMUNICATION_ERROR` or `APPLICATION_ERROR`)."""
        return self._behavior.reaction(self._dictionary.stored(error_class))

    def reset(self, now: float) -> None:
        """The objects hold their reset values: take them over."""
        self._take_emergency_settings()
        self.producer.configure(self._dictionary.stored(PRODUCER_HEARTBEAT), now)
        self.consumer.configure(self._dictionary.stored(CONSUMER_HEARTBEAT))

    # --- Watcher --------------------------------------------------------------------------------------------

    def veto(self, address: Address, value: int, now: float) -> AbortCode | None:  # noqa: ARG002
        """See `Watcher.veto`: identifiers and reserved bits that can't be are refused with 06090030h."""
        if address == SYNC_COB_ID:
            bad = bool(value & ~MAX_COB_ID) or is_restricted(value)
            return AbortCode.INVALID_VALUE if bad else None
        if address == EMCY_COB_ID:
            return emergency.veto_cob_id(value)
        if address == CONSUMER_HEARTBEAT:
            return AbortCode.INVALID_VALUE if value & _CONSUMER_RESERVED else None
        return self._behavior.veto(value) if address.index == ERROR_BEHAVIOR else None

    def written(self, address: Address, value: int, now: float) -> None:
        """See `Watcher.written`."""
        if address in (EMCY_COB_ID, EMCY_INHIBIT_TIME):
            self._take_emergency_settings()
        elif address == PRODUCER_HEARTBEAT:
            self.producer.configure(value, now)
        elif address == CONSUMER_HEARTBEAT:
            self.consumer.configure(value)

    def _take_emergency_settings(self) -> None:
        self._emergencies.configure(
            self._dictionary.stored(EMCY_COB_ID), self._dictionary.stored(EMCY_INHIBIT_TIME)
        )
