"""Revoked keys are refused by agents, routers and audits, and two swarms do not share keys by accident."""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from swarmctl.bus import keys as bus_keys
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.cli.main import cli
from swarmctl.security import participant
from swarmctl.security.evidence_keys import key_trouble, load_evidence_signer
from swarmctl.security.files import KeyringError
from swarmctl.security.issue import make_keys
from swarmctl.security.participant import load_keyring

NOW = dt.datetime.now(dt.UTC)
NAMES = ["uav1", "uav2", "operator", "router"]
CONFIGURATION = """\
name: NAME
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 4, cols: 4, cell_size_m: 50}
threats: {count: 1}
simulate: {count: 2}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_keys(tmp_path / "keys", NAMES, 5, NOW, {"uav1": ["10.0.0.1"]})
    return tmp_path / "keys"


@pytest.fixture
def stolen(folder: Path, tmp_path: Path) -> Path:
    """A thief's copy of the folder of uav1; the owner has revoked these keys since."""
    shutil.copytree(folder / "uav1", tmp_path / "stolen" / "uav1")
    make_keys(folder, NAMES, 5, NOW, revoke=["uav1"])
    return tmp_path / "stolen"


def test_a_revoked_signature_is_refused_and_the_new_one_accepted(stolen: Path, folder: Path) -> None:
    thief, owner = load_keyring(stolen, "uav1", NOW), load_keyring(folder, "uav1", NOW)
    for name in ("uav2", "operator"):
        ring = load_keyring(folder, name, NOW)
        for sender, is_valid in ((thief, False), (owner, True)):
            signature = sender.sign(1, b"data")
            assert signature is not None
            assert ring.verify(1, signature, b"data") is is_valid


def test_an_agent_in_flight_refuses_a_revoked_signature_after_the_copy(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    thief, agent = load_keyring(folder, "uav1", NOW), load_keyring(folder, "uav2", NOW)
    signature = thief.sign(1, b"data")
    assert signature is not None
    now_s = 1000.0
    monkeypatch.setattr(participant.time, "monotonic", lambda: now_s)
    assert agent.verify(1, signature, b"data")
    table = folder / "uav2" / "signers.json"
    whole = table.read_text()
    table.write_text(whole[:50])  # a copy that is still under way
    now_s += 1.0
    assert agent.verify(1, signature, b"data")
    table.write_text(whole)
    make_keys(folder, NAMES, 5, NOW, revoke=["uav1"])
    now_s += 1.0
    assert not agent.verify(1, signature, b"data")


def test_a_revoked_folder_is_refused_where_the_list_is_known(stolen: Path, folder: Path) -> None:
    shutil.copy(folder / "revoked.json", stolen / "uav1")
    with pytest.raises(KeyringError, match=r"cert\.pem.*\[certificate-revoked\]"):
        load_keyring(stolen, "uav1", NOW)


def test_all_other_folders_are_to_be_copied_and_hosts_are_kept(folder: Path) -> None:
    made = {item.name: item for item in make_keys(folder, NAMES, 5, NOW, revoke=["uav1"])}
    assert made["uav1"].is_new
    assert "10.0.0.1" in made["uav1"].hosts
    assert all(item.is_changed for name, item in made.items() if name != "uav1")
    assert [item.name for item in make_keys(folder, NAMES, 5, NOW) if item.is_new or item.is_changed] == []
    lists = {(folder / name / "revoked.json").read_bytes() for name in NAMES}
    assert lists == {(folder / "revoked.json").read_bytes()}
    (entry,) = json.loads(lists.pop())["uav1"]
    assert set(entry) == {"certificate", "key", "unix_s"}


def test_keys_can_be_revoked_again_and_a_missing_folder_cannot(folder: Path) -> None:
    for n in (1, 2):
        make_keys(folder, NAMES, 5, NOW, revoke=["uav1"])
        assert len(json.loads((folder / "revoked.json").read_text())["uav1"]) == n
        load_keyring(folder, "uav1", NOW)
    with pytest.raises(KeyringError, match="uav9"):
        make_keys(folder, NAMES, 5, NOW, revoke=["uav9"])


def test_evidence_with_a_revoked_key_is_named_as_such(stolen: Path, folder: Path) -> None:
    key = load_evidence_signer(stolen, "uav1").public_key
    assert key_trouble(folder, "uav1", key).endswith("[signed-with-revoked-key]")
    assert key_trouble(folder, "uav1", load_evidence_signer(folder, "uav1").public_key) == ""


@pytest.mark.interop
def test_a_router_passes_nothing_of_a_revoked_certificate(stolen: Path, folder: Path) -> None:
    async def scene() -> None:
        heard: list[bytes] = []
        credentials = load_keyring(folder, "router", NOW).credentials
        anywhere = BusEndpoint("127.0.0.1", 0, "tls")
        with ZenohBus(zenoh_config.router(anywhere, "test", [1, 2], credentials)) as router:
            assert router.endpoint is not None
            at = router.endpoint

            def joined(keys: Path, name: str) -> ZenohBus:
                return ZenohBus(zenoh_config.visitor(at, load_keyring(keys, name, NOW).credentials))

            with (
                joined(folder, "uav2") as two,
                joined(stolen, "uav1") as thief,
                joined(folder, "uav1") as one,
            ):
                arrived = asyncio.Event()

                def receive(_key: str, payload: bytes) -> None:
                    heard.append(payload)
                    arrived.set()

                two.subscribe(bus_keys.inbox("test", 2), receive)
                key = bus_keys.uav_message("test", 2, "inform/state", 1)
                for last in (b"first", b"last"):
                    async with asyncio.timeout(20.0):
                        while last not in heard:  # a subscription takes a moment to arrive
                            thief.put(key, b"thief")
                            one.put(key, last)
                            arrived.clear()
                            with contextlib.suppress(TimeoutError):
                                await asyncio.wait_for(arrived.wait(), 0.05)
        assert b"thief" not in heard

    asyncio.run(scene())


def keys_command(folder: Path, swarm: str, *words: str) -> Result:
    file = folder / f"{swarm}.yaml"
    file.write_text(CONFIGURATION.replace("NAME", swarm))
    return CliRunner().invoke(cli, ["keys", "--config", str(file), "--out", str(folder / "keys"), *words])


def test_a_second_swarm_in_one_folder_is_refused_unless_it_shares(tmp_path: Path) -> None:
    assert keys_command(tmp_path, "one").exit_code == 0
    before = {path: path.read_bytes() for path in (tmp_path / "keys").rglob("*") if path.is_file()}
    refused = keys_command(tmp_path, "two")
    assert refused.exit_code == 1
    assert "[keys-of-another-swarm]" in refused.stderr
    assert {path: path.read_bytes() for path in (tmp_path / "keys").rglob("*") if path.is_file()} == before
    assert keys_command(tmp_path, "two", "--share").exit_code == 0
    assert keys_command(tmp_path, "two").exit_code == 0
    assert keys_command(tmp_path, "one").exit_code == 0


def test_the_command_revokes_by_the_vehicles_name(tmp_path: Path) -> None:
    keys_command(tmp_path, "one")
    old = (tmp_path / "keys" / "uav2" / "sign.pem").read_bytes()
    result = keys_command(tmp_path, "one", "--revoke", "uav2")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "keys" / "uav2" / "sign.pem").read_bytes() != old
    assert keys_command(tmp_path, "one", "--revoke", "nobody").exit_code == 1


@pytest.mark.parametrize(("file", "content"), [("revoked.json", "[]"), ("uav1/revoked.json", "{")])
def test_a_broken_list_is_refused_with_its_file(file: str, content: str, stolen: Path, folder: Path) -> None:
    (folder / file).write_text(content)

    def used() -> None:
        load_keyring(folder, "uav1", NOW)
        make_keys(folder, NAMES, 5, NOW)

    with pytest.raises(KeyringError, match=r"revoked\.json"):
        used()


def test_a_file_of_the_user_is_kept_and_does_not_stop_the_revocation(folder: Path) -> None:
    old = (folder / "uav1" / "sign.pem").read_bytes()
    (folder / "uav1" / "notes.txt").write_text("the blue copter")
    (made, *_) = make_keys(folder, NAMES, 5, NOW, revoke=["uav1"])
    assert made.is_new
    assert (folder / "uav1" / "sign.pem").read_bytes() != old
    assert [path.read_text() for path in folder.rglob("notes.txt")] == ["the blue copter"]
    assert old not in {path.read_bytes() for path in folder.rglob("*.pem")}


def test_a_revocation_that_was_interrupted_amid_the_removal_is_completed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unlink = Path.unlink

    def interrupted(path: Path, *, missing_ok: bool = False) -> None:
        if path.name == "key.pem":
            raise KeyboardInterrupt
        unlink(path, missing_ok=missing_ok)

    old = (folder / "uav1" / "sign.pem").read_bytes()
    monkeypatch.setattr(Path, "unlink", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make_keys(folder, NAMES, 5, NOW, revoke=["uav1"])
    monkeypatch.undo()
    make_keys(folder, NAMES, 5, NOW)
    assert (folder / "uav1" / "sign.pem").read_bytes() != old
    assert len(json.loads((folder / "revoked.json").read_text())["uav1"]) == 1
    load_keyring(folder, "uav1", NOW)
