"""The hands on one simulated module, from another process."""

from __future__ import annotations

import httpx

from canaxis.contract.exchange import refusal, unreachable
from canaxis.contract.reading import read
from canaxis.testing.states import ModuleState


class Panel:
    """Presses switches, cuts the supply, loses frames. What it does stays until it is undone, or `clear`.

    Its commands are listed in docs/testing-with-the-simulator.md, with their arguments at `/docs` of the
    panel. Every method answers once it is done, and raises `canaxis.CanaxisError`: `BadValue` for an
    argument, which says what is allowed, `UnknownNode` for a module that is not there, `NotReady` for what
    can't be done now.
    """

    def __init__(self, http: httpx.Client, node: int) -> None:
        """For the module that was made as `node`; `http` knows where the panel is."""
        self._http = http
        self._path = f"nodes/{node}"

    def perform(self, command: str, **arguments: object) -> ModuleState:
        """Do what a command says: ``perform("block", axis=0)``. Returns what there is to see then."""
        return self._ask("POST", f"{self._path}/{command}", arguments)

    def state(self) -> ModuleState:
        """What there is to see now."""
        return self._ask("GET", self._path)

    def clear(self) -> ModuleState:
        """Undo everything: hands off, supply and connection back, and the module powered.

        Where the carriages stand, and what the module itself holds (a fault, parameters), stays.
        """
        return self._ask("POST", f"{self._path}/clear", {})

    def _ask(self, method: str, path: str, arguments: dict[str, object] | None = None) -> ModuleState:
        try:
            answer = self._http.request(method, path, json=arguments)
        except httpx.TransportError as error:
            raise unreachable(f"{type(error).__name__}: {error}", reached=False) from error
        if not answer.is_success:
            raise refusal(answer)
        return read(ModuleState, answer.json())
