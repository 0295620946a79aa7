"""Who may send what to whom, as Zenoh's access control: pure data from the swarm's name and system ids.

Everything is denied that no rule allows, for a rule that denies is passed by a put on a wildcard key.
Receivers are written out one by one for the same reason: a key such as `uav/*/inform/state/3` is within no
rule. (`uav/1/*/*/3` is within one, and reaches the one receiver that it names, who refuses it.)

A subject is a certificate's common name: `uav3` (the vehicle's companion, and a payload on it), `operator`
(the ground station and who gives commands), `router`. Without certificates everybody may do what each of them
may.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from swarmctl.bus import keys

OPERATOR = "operator"
ROUTER = "router"
IN, OUT = "ingress", "egress"
"""as seen from whoever holds the list: what comes from a link, what goes out by it"""


def name_of(uav: int) -> str:
    """The common name of a vehicle's certificate."""
    return f"uav{uav}"


@dataclass(frozen=True, slots=True)
class Rule:
    """These kinds of message may pass in these directions under these keys."""

    flows: tuple[str, ...]
    messages: tuple[str, ...]
    keys: tuple[str, ...]


def operator_endpoint_rules(ask_keys: Sequence[str], put_keys: Sequence[str]) -> dict[str, Any]:
    """Of a process with the whole swarm inside: from outside one may ask and put under these keys.

    Nothing but the answers goes out.
    """
    rules = [
        Rule((IN,), ("query",), tuple(ask_keys)),
        Rule((OUT,), ("reply", "declare_queryable"), tuple(ask_keys)),
        Rule((IN,), ("put",), tuple(put_keys)),
        Rule((OUT,), ("declare_subscriber",), tuple(put_keys)),
    ]
    return _access_control([(None, rules)])


def router_rules(swarm: str, uavs: Sequence[int], *, certified: bool) -> dict[str, Any]:
    """Of a router whose clients are the vehicles and operators of one swarm."""
    grants: list[tuple[str | None, list[Rule]]] = [
        (name_of(uav), _of_a_vehicle(swarm, uav, uavs)) for uav in uavs
    ]
    grants.append((OPERATOR, _of_an_operator(swarm, uavs)))
    if certified:
        return _access_control(grants)
    return _access_control([(None, _united(rule for _, rules in grants for rule in rules))])


def mesh_node_rules(swarm: str, uavs: Sequence[int], *, certified: bool) -> dict[str, Any]:
    """Of a node among nodes that pass on for each other: only the swarm's certificates, only its keys.

    A neighbour sends what others have said, so the link does not tell who that was; the receiver tells by
    the message's signature. A payload's looks have none, and so no node passes them on: they come in from
    the vehicle's own certificate or an operator's, and reach that vehicle's agent only at its own node.
    """
    root, every_look = f"{keys.ROOT}/{swarm}", tuple(keys.sensor_report(swarm, uav) for uav in uavs)
    said = [f"{root}/uav/*/*/*/{uav}" for uav in uavs]
    passed_on = (*said, f"{root}/uav/*/request/*/{OPERATOR}", f"{root}/station/**")
    shared = [
        Rule((IN, OUT), ("declare_subscriber", "declare_queryable"), (f"{root}/**",)),
        Rule((IN, OUT), ("put", "query", "reply"), passed_on),
    ]

    def with_looks(looks: tuple[str, ...]) -> list[Rule]:
        return [*shared, Rule((IN,), ("put", "query"), looks), Rule((OUT,), ("reply",), looks)]

    if not certified:
        return _access_control([(None, with_looks(every_look))])
    vehicles = [(name_of(uav), with_looks((keys.sensor_report(swarm, uav),))) for uav in uavs]
    return _access_control([*vehicles, (OPERATOR, with_looks(every_look)), (ROUTER, shared)])


def _of_a_vehicle(swarm: str, uav: int, uavs: Sequence[int]) -> list[Rule]:
    root = f"{keys.ROOT}/{swarm}"
    says = tuple(f"{root}/uav/{to}/*/*/{uav}" for to in uavs if to != uav)
    look = keys.sensor_report(swarm, uav)
    inbox = (keys.inbox(swarm, uav),)
    return [
        Rule((IN,), ("put",), (*says, f"{root}/station/*/*/{uav}", look)),
        Rule((IN,), ("declare_subscriber", "declare_queryable", "reply"), inbox),
        Rule((OUT,), ("put", "query"), inbox),
        # Its payload, which has the vehicle's certificate, asks and is answered.
        Rule((IN,), ("query",), (look,)),
        Rule((OUT,), ("reply", "declare_queryable", "declare_subscriber"), (look,)),
    ]


def _of_an_operator(swarm: str, uavs: Sequence[int]) -> list[Rule]:
    looks = tuple(keys.sensor_report(swarm, uav) for uav in uavs)
    requests = tuple(keys.request(swarm, kind, uav) for uav in uavs for kind in keys.KINDS)
    station = (f"{keys.ROOT}/{swarm}/station/**",)
    return [
        Rule((IN,), ("query",), requests + looks),
        Rule((OUT,), ("reply", "declare_queryable"), requests + looks),
        Rule((IN,), ("put",), looks),
        Rule((OUT,), ("declare_subscriber",), looks),
        Rule((IN,), ("declare_subscriber",), station),
        Rule((OUT,), ("put",), station),
    ]


def _united(rules: Iterable[Rule]) -> list[Rule]:
    """The same with one rule for each direction and kinds of message."""
    united: dict[tuple[tuple[str, ...], tuple[str, ...]], dict[str, None]] = {}
    for rule in rules:
        united.setdefault((rule.flows, rule.messages), {}).update(dict.fromkeys(rule.keys))
    return [Rule(flows, messages, tuple(named)) for (flows, messages), named in united.items()]


def _access_control(grants: Sequence[tuple[str | None, list[Rule]]]) -> dict[str, Any]:
    """Zenoh's `access_control`; the subject None is anybody."""
    rules, subjects, policies = [], [], []
    for name, granted in grants:
        who = name or "anybody"
        ids = []
        for number, rule in enumerate(rule for rule in granted if rule.keys):
            ids.append(f"{who}-{number}")
            rules.append(
                {
                    "id": ids[-1],
                    "permission": "allow",
                    "flows": list(rule.flows),
                    "messages": list(rule.messages),
                    "key_exprs": list(rule.keys),
                }
            )
        subjects.append({"id": who} if name is None else {"id": who, "cert_common_names": [name]})
        policies.append({"rules": ids, "subjects": [who]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }
