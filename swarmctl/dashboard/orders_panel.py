"""Orders of the person at the page: launch, hold, resume, return, land, and the abort for all vehicles."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import Literal

from nicegui import ui

from swarmctl.core.messages import GiveOrder, Request, VehicleAnswer
from swarmctl.core.operator_text import typed_names
from swarmctl.dashboard.model import Timeline
from swarmctl.report.answers import order_line

Send = Callable[[Request], Awaitable[Sequence[VehicleAnswer]]]
"""sends a request the way of `swarmctl order` and `set`; raises NotSent"""
Order = Literal["launch", "hold", "resume", "return", "land"]
ORDERS: tuple[Order, ...] = ("launch", "hold", "resume", "return", "land")
ABORTS: tuple[Order, ...] = ("hold", "return", "land")


class NotSent(Exception):
    """A command without an answer; the text has the reason."""


class OrdersPanel:
    """Buttons for the chosen vehicle or for all. Each order is confirmed in a dialog.

    The launch of a vehicle that the built-in simulator does not play is confirmed by typing its name.
    """

    def __init__(self, timeline: Timeline, send: Send) -> None:
        self._timeline, self._send, self._whose = timeline, send, ""
        self._real = [spec.name for spec in timeline.scenario.swarm if not spec.simulated]
        with ui.row().classes("orders w-full items-center gap-1"):
            self._title = ui.label().classes("w-full text-sm font-semibold")
            for order in ORDERS:
                button = ui.button(order.capitalize(), on_click=partial(self._ask, order))
                button.props("dense outline no-caps")
        self.choose("")

    def choose(self, whose: str) -> None:
        """Turn to another vehicle, or to all."""
        self._whose = whose
        self._title.set_text(f"Order {whose or 'all vehicles'}:")

    async def _ask(self, order: Order) -> None:
        whose = self._whose
        names = [whose] if whose else list(self._timeline.area.names)
        to_type = [name for name in names if name in self._real] if order == "launch" else []
        if await confirmed(f"Order {', '.join(names)} to {order}?", "Give the order", to_type):
            request = GiveOrder((whose,) if whose else None, order)
            await send_and_tell(self._send, request, lambda answer: order_line(order, answer))


class AbortButton:
    """A button that ends the flight of all vehicles, whichever is chosen: hold, return or land."""

    def __init__(self, send: Send) -> None:
        self._send = send
        button = ui.button("Abort", on_click=self._ask).props("dense no-caps color=negative")
        button.classes("abort").tooltip("All vehicles hold, return or land")

    async def _ask(self) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.label("Abort the flight of all vehicles?").classes("font-semibold")
            with ui.row():
                for order in ABORTS:
                    button = ui.button(f"All {order}", on_click=partial(dialog.submit, order))
                    button.props("no-caps color=negative")
                ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("no-caps flat")
        dialog.on("hide", dialog.delete)
        order = await dialog
        if order in ABORTS:
            await send_and_tell(self._send, GiveOrder(None, order), partial(order_line, order))


async def send_and_tell(send: Send, request: Request, line_of: Callable[[VehicleAnswer], str]) -> None:
    """Send a request and show its answers, a line a vehicle; a refusal stays until it is closed."""
    try:
        answers = await send(request)
    except NotSent as error:
        tell([str(error)], is_good=False)
        return
    for is_good in (True, False):
        tell([line_of(v) for v in answers if (v.outcome == "taken") is is_good], is_good=is_good)


def tell(lines: Sequence[str], *, is_good: bool) -> None:
    if lines:
        ui.notify(
            "\n".join(lines),
            type="positive" if is_good else "negative",
            position="bottom",
            timeout=8000 if is_good else 0,
            close_button=not is_good and "Close",
            multi_line=True,
        )


async def confirmed(question: str, yes: str, real: Sequence[str] = ()) -> bool:
    """Ask a person, and return the answer; `real`: names of vehicles that the person has to type."""
    with ui.dialog() as dialog, ui.card():
        ui.label(question).classes("font-semibold")
        typed = None
        if real:
            ui.label(f"This arms real vehicles. Type their names: {','.join(real)}")
            typed = ui.input("Names").props("autofocus")
        with ui.row():
            button = ui.button(yes, on_click=lambda: dialog.submit(True)).props("no-caps")
            if typed is not None:
                button.bind_enabled_from(typed, "value", lambda value: _are(value, real))
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("no-caps flat")
    dialog.on("hide", dialog.delete)  # once the focus is back at the button that opened the dialog
    answer = await dialog
    # A browser may send a click on a disabled button, so the names are compared here too.
    is_typed = typed is None or _are(typed.value, real)
    return bool(answer) and is_typed


def _are(typed: str | None, names: Sequence[str]) -> bool:
    return sorted(typed_names(typed or "")) == sorted(names)
