"""Zenoh access control of the swarm's participants, from the swarm's name and system ids. No I/O.

The rules only allow; everything else is denied. A deny rule would not stop a put on a wildcard key. For the
same reason a router's rules list each receiver, and include no key such as `uav/*/inform/state/3`. A rule
includes `uav/1/*/*/3`, but only UAV 1 receives such a put, and UAV 1 refuses wildcards.

A subject is a certificate's common name: `uav3` (a vehicle's companion and payloads), `operator` (ground
station and operators' commands), or `router`; after a revocation `uav3-2`. Without certificates every process
has the rights of all subjects.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from swarmctl.bus import keys

OPERATOR = "operator"
ROUTER = "router"
IN, OUT = "ingress", "egress"
"""direction, as seen from the process with the rules: received over a link, sent over a link"""


def name_of(uav: int) -> str:
    """Return the common name of a vehicle's certificate."""
    return f"uav{uav}"


class Rule(msgspec.Struct, frozen=True):
    """Permission of Zenoh's message kinds, by direction and keys."""

    flows: tuple[str, ...]
    messages: tuple[str, ...]
    keys: tuple[str, ...]


def endpoint_rules(swarm: str, uavs: Sequence[int]) -> dict[str, Any]:
    """Return the rules of a process with the whole swarm; the process sends nothing but answers."""
    return _access_control([(None, _request_rules(swarm, uavs, keys.swarm_vehicles(swarm)))])


def router_rules(
    swarm: str, uavs: Sequence[int], *, common_names: Mapping[str, str] | None
) -> dict[str, Any]:
    """Return the rules of a router whose clients are the vehicles and operators of one swarm.

    common_names: those of certificates that differ from the participant's name; None: no certificates
    """
    grants: list[tuple[str | None, list[Rule]]] = [
        (name_of(uav), _vehicle_rules(swarm, uav, uavs)) for uav in uavs
    ]
    grants.append((OPERATOR, _operator_rules(swarm, uavs)))
    if common_names is not None:
        return _access_control(grants, common_names)
    return _access_control([(None, _merged(rule for _, rules in grants for rule in rules))])


def mesh_node_rules(
    swarm: str, uavs: Sequence[int], *, common_names: Mapping[str, str] | None
) -> dict[str, Any]:
    """Return the rules of a mesh node: only the swarm's bus keys and its certificates, if it has any.

    common_names: those of certificates that differ from the participant's name; None: no certificates

    A neighbour relays messages, so a link does not authenticate a message's sender; the receiver checks the
    message's signature. With certificates a payload's reports have no signature, so nodes do not relay them:
    a report must arrive over a link with the certificate of the reported vehicle or of an operator.
    """
    root, all_reports = f"{keys.ROOT}/{swarm}", tuple(keys.sensor_report(swarm, uav) for uav in uavs)
    from_uavs = [f"{root}/uav/*/*/*/{uav}" for uav in uavs]
    relayed = (*from_uavs, f"{root}/uav/*/request/*/{OPERATOR}", f"{root}/station/**")
    shared = [
        Rule((IN, OUT), ("declare_subscriber", "declare_queryable"), (f"{root}/**",)),
        Rule((IN, OUT), ("put", "query", "reply"), relayed),
    ]

    def with_reports(reports: tuple[str, ...]) -> list[Rule]:
        return [*shared, Rule((IN,), ("put", "query"), reports), Rule((OUT,), ("reply",), reports)]

    if common_names is None:
        return _access_control([(None, with_reports(all_reports))])
    vehicles = [(name_of(uav), with_reports((keys.sensor_report(swarm, uav),))) for uav in uavs]
    return _access_control([*vehicles, (OPERATOR, with_reports(all_reports)), (ROUTER, shared)], common_names)


def _vehicle_rules(swarm: str, uav: int, uavs: Sequence[int]) -> list[Rule]:
    root = f"{keys.ROOT}/{swarm}"
    own_messages = tuple(f"{root}/uav/{to}/*/*/{uav}" for to in uavs if to != uav)
    report = keys.sensor_report(swarm, uav)
    inbox = (keys.inbox(swarm, uav),)
    return [
        Rule((IN,), ("put",), (*own_messages, f"{root}/station/*/*/{uav}", report)),
        Rule((IN,), ("declare_subscriber", "declare_queryable", "reply"), inbox),
        Rule((OUT,), ("put", "query"), inbox),
        # A payload has its vehicle's certificate, and gets answers to its reports.
        Rule((IN,), ("query",), (report,)),
        Rule((OUT,), ("reply", "declare_queryable", "declare_subscriber"), (report,)),
    ]


def _operator_rules(swarm: str, uavs: Sequence[int]) -> list[Rule]:
    station = (f"{keys.ROOT}/{swarm}/station/**",)
    return [
        *_request_rules(swarm, uavs),
        Rule((IN,), ("declare_subscriber",), station),
        Rule((OUT,), ("put",), station),
    ]


def _request_rules(swarm: str, uavs: Sequence[int], *questions: str) -> list[Rule]:
    """Return the rules of commands and reports to vehicles, and of questions under other keys."""
    reports = tuple(keys.sensor_report(swarm, uav) for uav in uavs)
    requests = tuple(keys.request(swarm, kind, uav) for uav in uavs for kind in keys.REQUEST_KINDS)
    asked = (*questions, *requests, *reports)
    return [
        Rule((IN,), ("query",), asked),
        Rule((OUT,), ("reply", "declare_queryable"), asked),
        Rule((IN,), ("put",), reports),
        Rule((OUT,), ("declare_subscriber",), reports),
    ]


def _merged(rules: Iterable[Rule]) -> list[Rule]:
    merged: dict[tuple[tuple[str, ...], tuple[str, ...]], dict[str, None]] = {}
    for rule in rules:
        merged.setdefault((rule.flows, rule.messages), {}).update(dict.fromkeys(rule.keys))
    return [Rule(flows, messages, tuple(named)) for (flows, messages), named in merged.items()]


def _access_control(
    grants: Sequence[tuple[str | None, list[Rule]]], common_names: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return Zenoh's `access_control`; the subject None matches every process."""
    certificates = common_names or {}
    rules, subjects, policies = [], [], []
    for name, allowed in grants:
        subject = name or "anybody"
        ids = []
        for number, rule in enumerate(rule for rule in allowed if rule.keys):
            ids.append(f"{subject}-{number}")
            rules.append(
                {
                    "id": ids[-1],
                    "permission": "allow",
                    "flows": list(rule.flows),
                    "messages": list(rule.messages),
                    "key_exprs": list(rule.keys),
                }
            )
        certified = {} if name is None else {"cert_common_names": [certificates.get(name, name)]}
        subjects.append({"id": subject, **certified})
        policies.append({"rules": ids, "subjects": [subject]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }
