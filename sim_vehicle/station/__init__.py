"""The one client of vehicles, without sockets and clocks: for scenarios, the conformance suite and test rigs.

`frames` packs and parses messages. `exchanges` has the requests to one vehicle; `messages`, `plan_items` and
`parameter_values` have their contents. `status_texts` joins the chunks of texts. The simulated vehicles are
not imported, so the client fits any vehicle.
"""
