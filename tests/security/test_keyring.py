"""Keys of a swarm: made once, extended, and loaded whole or refused with a remedy."""

from __future__ import annotations

import datetime as dt
import json
import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarmctl.cli.main import cli
from swarmctl.security.files import KeyringError
from swarmctl.security.issue import make_keys
from swarmctl.security.participant import find_problems, load_keyring

NOW = dt.datetime(2030, 5, 1, 12, 0, tzinfo=dt.UTC)
NAMES = ["uav1", "uav3", "operator", "router"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "keys"
    make_keys(made, NAMES, 30, NOW, {"router": ["10.0.0.7", "ground.example"]})
    return made


def test_each_participant_has_a_folder_with_private_keys_readable_by_its_owner_only(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted([*NAMES, "ca"])
    for name in NAMES:
        files = {path.name: stat.S_IMODE(path.stat().st_mode) for path in (folder / name).iterdir()}
        assert set(files) == {"ca.pem", "cert.pem", "key.pem", "sign.pem", "signers.json"}
        assert files["key.pem"] == files["sign.pem"] == 0o600
        assert load_keyring(folder, name, NOW).name == name
    assert stat.S_IMODE((folder / "ca" / "key.pem").stat().st_mode) == 0o600
    assert not list(folder.rglob(".*"))


def test_a_wide_umask_leaves_keys_private(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        make_keys(tmp_path / "keys", ["uav1"], 1, NOW)
    finally:
        os.umask(before)
    assert load_keyring(tmp_path / "keys", "uav1", NOW).name == "uav1"


def test_a_signature_is_valid_for_its_owner_only(folder: Path) -> None:
    three, router = load_keyring(folder, "uav3", NOW), load_keyring(folder, "router", NOW)
    signature = three.sign(3, b"text")
    assert signature is not None
    assert len(signature) == 64
    assert router.verify(3, signature, b"text")
    assert not router.verify(1, signature, b"text")
    assert not router.verify(3, signature, b"other text")
    assert not router.verify(3, b"", b"text")
    assert not router.verify(9, signature, b"text")
    assert three.sign(1, b"text") is None


def test_a_second_run_keeps_the_present_keys_and_adds_the_missing_keys(folder: Path) -> None:
    before = {path: path.read_bytes() for path in folder.rglob("*.pem")}
    made = make_keys(folder, [*NAMES, "uav4"], 30, NOW + dt.timedelta(days=1))
    assert [one.name for one in made if one.is_new] == ["uav4"]
    assert {path: path.read_bytes() for path in before} == before
    for name in (*NAMES, "uav4"):
        assert set(load_keyring(folder, name, NOW + dt.timedelta(days=1)).public_keys) == {*NAMES, "uav4"}


def test_a_second_run_marks_the_folders_to_copy_again(folder: Path) -> None:
    again = make_keys(folder, NAMES, 30, NOW)
    assert not any(one.is_new or one.is_changed for one in again)
    shutil.rmtree(folder / "uav3")
    state = {one.name: (one.is_new, one.is_changed) for one in make_keys(folder, [*NAMES, "uav4"], 30, NOW)}
    assert state.pop("uav3") == state.pop("uav4") == (True, False)
    assert state == dict.fromkeys(("uav1", "operator", "router"), (False, True))
    (folder / "uav1" / "signers.json").unlink()
    assert [one.name for one in make_keys(folder, NAMES, 30, NOW) if one.is_changed] == ["uav1"]


Change = Callable[[Path], object]


def without(*names: str) -> Change:
    """Return a change of a folder of keys that removes participants."""
    return lambda folder: [shutil.rmtree(folder / name) for name in names]


def copied(source: str, target: str) -> Change:
    """Return a change that replaces a file, or a participant's whole folder, with another one."""

    def change(folder: Path) -> None:
        if (folder / source).is_dir():
            shutil.rmtree(folder / target)
            shutil.copytree(folder / source, folder / target)
        else:
            shutil.copy(folder / source, folder / target)

    return change


def of_another_swarm(*names: str) -> Change:
    """Return a change that replaces the folder of uav3, or these files, with those of another swarm."""

    def change(folder: Path) -> None:
        make_keys(folder.parent / "others", ["uav3"], 30, NOW)
        for name in names:
            copied(f"../others/uav3/{name}", f"uav3/{name}")(folder)

    return change


FOLDER_CASES: list[tuple[Change, int, list[str]]] = [
    # change to the folder, days later, lines reported
    (without(), 0, []),
    (without("ca", "uav1", "operator", "router"), 0, []),  # copied to a companion
    (shutil.rmtree, 0, ["keys/uav1: "]),
    (without("uav3"), 0, ["keys/uav3: "]),
    (of_another_swarm(""), 0, ["keys/uav1/ca.pem"]),
    (without(), 31, [f"keys/{name}/cert.pem was valid until 2030-05-31 12:00 UTC" for name in NAMES]),
]


@pytest.mark.parametrize(("change", "days", "lines"), FOLDER_CASES)
def test_unusable_keys_are_found_before_they_are_needed(
    folder: Path, change: Change, days: int, lines: list[str]
) -> None:
    change(folder)
    found = list(find_problems(folder, NAMES, NOW + dt.timedelta(days=days)))
    assert len(found) == len(lines), found
    for line, part in zip(found, lines, strict=True):
        assert part in line


def test_a_certificate_names_its_owner_and_all_its_hosts(folder: Path) -> None:
    by_name = {one.name: one for one in make_keys(folder, NAMES, 30, NOW)}
    assert by_name["router"].hosts == ("router", "localhost", "127.0.0.1", "10.0.0.7", "ground.example")
    # No other participant's certificate is valid for the router's machine.
    assert by_name["uav3"].hosts == ("uav3", "localhost", "127.0.0.1")
    assert by_name["uav3"].until == NOW + dt.timedelta(days=30)


def written(file: str, content: str) -> Change:
    return lambda folder: (folder / file).write_text(content)


ANOTHERS_KEY = (copied("uav1/key.pem", "uav3/key.pem"), r"uav3/key.pem .*uav3/cert.pem")
ANOTHERS_FOLDER = (copied("uav1", "uav3"), r"uav3/cert.pem .* uav3;")
CUT_OFF = (written("uav3/cert.pem", "-----BEGIN CERTIFICATE-----"), r"uav3/cert.pem .*PEM")
FOREIGN = of_another_swarm("cert.pem", "key.pem")
BROKEN: dict[str, tuple[Change, str]] = {
    "no table": (
        lambda folder: (folder / "uav3" / "signers.json").unlink(),
        r"uav3/signers.json: No such file.*`swarmctl keys`",
    ),
    "a readable key": (
        lambda folder: (folder / "uav3" / "key.pem").chmod(0o640), r"uav3/key.pem .*0640.*chmod 600",
    ),
    "a readable signing key": (
        lambda folder: (folder / "uav3" / "sign.pem").chmod(0o604), r"uav3/sign.pem .*0604.*chmod 600",
    ),
    "another's key": ANOTHERS_KEY,
    "another's signing key": (copied("uav1/sign.pem", "uav3/sign.pem"), r"signers.json .*uav3/sign.pem"),
    "another's folder": ANOTHERS_FOLDER,
    "another swarm's certificate": (FOREIGN, r"uav3/cert.pem .*uav3/ca.pem"),
    "a cut certificate": CUT_OFF,
    "no key": (written("uav3/key.pem", "nonsense"), r"uav3/key.pem .*PEM"),
    "a wrong table": (written("uav3/signers.json", '{"uav3": "AAAA"}'), r"uav3/signers.json "),
    "no folder": (without("uav3"), r"uav3: .*`swarmctl keys --out "),
}  # fmt: skip


@pytest.mark.parametrize(("change", "found"), BROKEN.values(), ids=BROKEN)
def test_a_broken_folder_is_refused_with_its_file(change: Change, found: str, folder: Path) -> None:
    change(folder)
    with pytest.raises(KeyringError, match=found):
        load_keyring(folder, "uav3", NOW)


@pytest.mark.parametrize(
    ("days", "why"),
    [(31, r"2030-05-31 12:00 UTC"), (-2, r"2030-04-30 .*UTC")],
)
def test_a_certificate_outside_its_validity_is_refused_with_the_date(
    days: int, why: str, folder: Path
) -> None:
    with pytest.raises(KeyringError, match=why):
        load_keyring(folder, "uav3", NOW + dt.timedelta(days=days))


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ANOTHERS_FOLDER,
        (FOREIGN, r"uav3/cert.pem .*/ca\b"),
        ANOTHERS_KEY,
        CUT_OFF,
        (copied("uav1/key.pem", "ca/key.pem"), r"ca/key.pem .*ca/ca.pem"),
        (lambda folder: (folder / "ca" / "key.pem").unlink(), r"ca/key.pem: No such file"),
    ],
)
def test_broken_and_foreign_folders_are_not_extended(change: Change, found: str, folder: Path) -> None:
    change(folder)
    with pytest.raises(KeyringError, match=found):
        make_keys(folder, NAMES, 30, NOW)


@pytest.mark.parametrize("name", ["", "ca", "uav0", "uav03", "../uav3", "uav3/", "station", "UAV3"])
def test_only_participants_get_certificates(name: str, tmp_path: Path) -> None:
    with pytest.raises(KeyringError, match="uav254"):
        make_keys(tmp_path, [name], 30, NOW)


def test_an_existing_certificate_without_a_new_host_is_refused(folder: Path) -> None:
    with pytest.raises(KeyringError, match=r"10.0.0.9; remove .*/router"):
        make_keys(folder, NAMES, 30, NOW, {"router": ["10.0.0.7", "10.0.0.9"]})


def test_an_unwritable_folder_is_refused_with_its_path(tmp_path: Path) -> None:
    (tmp_path / "keys").write_text("a file at the path of the folder")
    with pytest.raises(KeyringError, match=r"keys.*: (Not a directory|File exists)"):
        make_keys(tmp_path / "keys", ["uav1"], 30, NOW)


# --- the commands


CONFIG = """\
name: wide
area: {origin_lat_deg: 46.05, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 2}
simulate: {count: 2}
communication: {router: tls/10.0.0.7:7447, keys: KEYS}
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "swarm.yaml"
    path.write_text(CONFIG.replace("KEYS", str(tmp_path / "keys")))
    return path


def test_keys_are_made_for_all_participants_of_a_configuration(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "keys"
    result = CliRunner().invoke(
        cli, ["keys", "--config", str(config), "--out", str(out), "--host", "router=ground"]
    )
    assert result.exit_code == 0, result.output
    assert {path.name for path in out.iterdir()} == {"ca", "uav1", "uav2", "operator", "router"}
    now = dt.datetime.now(dt.UTC)
    (router,) = make_keys(out, ["router"], 1, now)
    assert router.hosts == ("router", "localhost", "127.0.0.1", "10.0.0.7", "ground")
    for word in ("uav1", "operator", "valid until", str(out / "ca")):
        assert word in result.output


def test_a_host_without_a_participant_is_refused(config: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["keys", "--config", str(config), "--host", "ground"])
    assert result.exit_code == 2
    assert "NAME=HOST" in result.output


def test_the_configuration_of_the_router_is_printed_for_zenohd(config: Path, tmp_path: Path) -> None:
    make_keys(tmp_path / "keys", ["router"], 30, dt.datetime.now(dt.UTC))
    result = CliRunner().invoke(cli, ["router", "--config", str(config), "--print"])
    assert result.exit_code == 0, result.output
    printed = json.loads(result.output)
    assert printed["mode"] == "router"
    assert printed["listen"]["endpoints"] == ["tls/10.0.0.7:7447"]
    assert printed["access_control"]["default_permission"] == "deny"
    assert printed["transport"]["link"]["tls"]["enable_mtls"] is True


@pytest.mark.parametrize(
    ("options", "code", "reason"),
    [
        ([], 1, "/router: "),
        (["--listen", "nowhere"], 2, "tcp/HOST:PORT"),
        (["--listen", "tcp/127.0.0.1:0", "--keys", "keys"], 2, "--keys"),
    ],
)
def test_a_router_that_cannot_start_reports_the_reason(
    options: list[str], code: int, reason: str, config: Path
) -> None:
    result = CliRunner().invoke(cli, ["router", "--config", str(config), *options])
    assert result.exit_code == code
    assert reason in " ".join(result.output.split())


def test_the_command_names_the_folders_to_copy_again(config: Path, tmp_path: Path) -> None:
    words = ["keys", "--config", str(config), "--out", str(tmp_path / "keys")]
    outputs = []
    for gone in ("", "", "uav2"):
        if gone:
            shutil.rmtree(tmp_path / "keys" / gone)
        result = CliRunner().invoke(cli, words)
        assert result.exit_code == 0, result.output
        outputs.append(result.output)
    assert "uav1" in outputs[0]
    assert "Copy" not in outputs[1]
    table, again = outputs[2].split("Copy these")
    assert table.count("changed") == 3  # all but uav2 get its new public key
    for name in ("uav1", "uav2", "operator", "router"):
        assert str(tmp_path / "keys" / name) in again


def test_the_check_of_a_configuration_includes_its_keys(config: Path, tmp_path: Path) -> None:
    words = ["check", "--config", str(config), "--out", str(tmp_path / "runs")]
    missing = CliRunner().invoke(cli, words)
    assert (missing.exit_code, "keys/uav1: " in missing.stderr) == (1, True)
    names, now = ["uav1", "uav2", "operator", "router"], dt.datetime.now(dt.UTC)
    make_keys(tmp_path / "keys", names, 30, now)
    assert CliRunner().invoke(cli, words).exit_code == 0
    shutil.rmtree(tmp_path / "keys")
    make_keys(tmp_path / "keys", names, 1, now - dt.timedelta(days=2))
    expired = CliRunner().invoke(cli, words)
    assert (expired.exit_code, expired.stderr.count("[certificate-expired]")) == (1, 4)
