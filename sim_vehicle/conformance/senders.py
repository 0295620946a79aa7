"""Where each system on a UDP port is: it may move, as after a reboot, but nobody takes its place."""

from typing import Any

QUIET_S = 1.0  # of vehicle time; one that was heard more lately has not moved


class Senders:
    """Addresses by system id; two that use one id at a time are two vehicles, and only one was asked for."""

    def __init__(self) -> None:
        self._addresses: dict[int, Any] = {}
        self._heard_s: dict[int, float] = {}
        self._doubted: set[int] = set()

    @property
    def addresses(self) -> list[Any]:
        """Of all systems, each once."""
        return list(dict.fromkeys(self._addresses.values()))

    def address(self, sysid: int) -> Any | None:
        return self._addresses.get(sysid)

    def heard(self, sysid: int, address: Any, now_s: float) -> bool:
        """Note a sender; False if the id belongs to another one, whose place it then never takes."""
        known = self._addresses.get(sysid)
        if known is not None and known != address:
            if now_s - self._heard_s[sysid] <= QUIET_S:
                self._doubted.add(sysid)
            if sysid in self._doubted:
                return False
        self._addresses[sysid], self._heard_s[sysid] = address, now_s
        return True
