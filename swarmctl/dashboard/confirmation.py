"""The dialog before an order or a flight; real vehicles are confirmed by typing their names."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from swarmctl.core.operator_text import typed_names


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
