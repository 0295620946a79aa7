"""Nobody decides for the vehicles any more: they are told to leave the air."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence

from swarmctl.agent.state import Phase
from swarmctl.core.events import Order
from swarmctl.flight.member import Member, names
from swarmctl.flight.shutdown import turns_to_return
from swarmctl.links.base import LinkError

TRIED_S = 10.0
"""for so long each order is tried"""


async def at_once(why: str, members: Sequence[Member], order: Order, say: Callable[[str], None]) -> None:
    """An operator waits no longer for anything."""
    armed = _to_bring(members)
    if armed:
        say(f"{why}: {names(armed)} to {order}, all at once")
        await asyncio.gather(*(_tell(member, order, looks_first=False) for member in armed))


async def in_turns(
    why: str,
    members: Sequence[Member],
    order: Order,
    say: Callable[[str], None],
    *,
    within_s: float,
    speedup: float,
) -> None:
    """Their agents are gone, and nobody has ordered this: who is somebody else's is let be.

    Who returns waits in hold for its turn, so that no two meet, for `within_s` at most. `speedup`: seconds of
    the vehicles' in one of ours.
    """
    armed = _to_bring(members)
    if not armed:
        return
    called = [member.spec.sysid for member in armed] if order is Order.RETURN else []
    say(f"{why}: {names(armed)} to {order}{', in turns' if len(called) > 1 else ''}")
    turns = turns_to_return(armed, say, called)

    async def bring(member: Member) -> None:
        after_s = min(turns.get(member.spec.sysid, 0.0) / speedup, within_s)
        if after_s > 0.0:
            began_s = _now_s()
            holds = await _tell(member, Order.HOLD, looks_first=True)
            await asyncio.sleep(max(began_s + after_s - _now_s(), 0.0))
            if holds and member.runner.link.state().mode_role != "hold":
                return  # somebody has chosen another mode meanwhile
        await _tell(member, order, looks_first=True)

    await asyncio.gather(*map(bring, armed))


def _to_bring(members: Sequence[Member]) -> list[Member]:
    return [m for m in members if m.state.vehicle.armed and m.state.phase is not Phase.RELEASED]


async def _tell(member: Member, order: Order, *, looks_first: bool) -> bool:
    """Whether it was seen to follow."""
    link = member.runner.link
    action = {Order.HOLD: link.hold, Order.LAND: link.land}.get(order, link.return_home)
    with contextlib.suppress(LinkError, TimeoutError):
        async with asyncio.timeout(TRIED_S):
            await action(looks_first=looks_first)
            return True
    return False


def _now_s() -> float:
    return asyncio.get_running_loop().time()
