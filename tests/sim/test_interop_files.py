"""MAVSDK and pymavlink's FTP client read logs, parameters and metadata over loopback."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
from mavsdk.plugins.ftp import Ftp, FtpResult
from mavsdk.plugins.log_files import LogFiles, LogFilesResult
from mavsdk_peer import COPTERS, MavsdkPeer, StreamedValues, Vehicle, connected, finish
from pymavlink import DFReader

pytestmark = [pytest.mark.interop, pytest.mark.full]


@pytest.fixture(scope="module")
def peer() -> Iterator[MavsdkPeer]:
    with connected("--personality", "ardupilot:1,px4:4", "--speedup", "15", *COPTERS) as found:
        yield found


def hop(vehicle: Vehicle) -> None:
    """Take off, land and wait until disarmed."""
    vehicle.take_off(5.0)
    vehicle.action.land()
    vehicle.disarmed()


@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_mavsdk_lists_and_downloads_the_log_of_a_flight(
    peer: MavsdkPeer, personality: str, tmp_path: Path
) -> None:
    vehicle = peer.take(personality)
    hop(vehicle)
    logs = vehicle.plugin(LogFiles)
    result, entries = finish(lambda known: logs.get_entries_async(lambda *a: known(*a[:2])))
    assert result == LogFilesResult.SUCCESS
    assert len(entries) == 1
    path = tmp_path / "flight"
    done = finish(lambda known: logs.download_log_file_async(entries[0], str(path), lambda *a: known(*a[:2])))
    assert done[0] == LogFilesResult.SUCCESS
    content = path.read_bytes()
    assert len(content) == entries[0].size_bytes > 5_000
    if personality == "ardupilot":
        reader = DFReader.DFReader_binary(str(path))
        heights = []
        while (message := reader.recv_match(type=["POS"])) is not None:
            heights.append(message.RelHomeAlt)
        reader.close()
        assert max(heights) > 4.0
    else:
        assert content.startswith(b"ULog")


@pytest.mark.parametrize("burst", [False, True])
def test_mavsdk_lists_reads_writes_and_compares_files(peer: MavsdkPeer, burst: bool, tmp_path: Path) -> None:
    ftp = peer.take("px4").plugin(Ftp)
    listed = finish(lambda known: ftp.list_directory_async("/etc/extras", lambda *a: known(*a[:2])))
    assert [entry.name for entry in listed[1].entries] == [
        "component_general.json.xz",
        "parameters.json.xz",
    ]
    remote = "/etc/extras/parameters.json.xz"
    known = finish(lambda known: ftp.download_async(remote, str(tmp_path), burst, lambda *a: known(*a[:2])))
    assert known[0] == FtpResult.SUCCESS
    local = tmp_path / "parameters.json.xz"
    assert ftp.are_files_identical(str(local), remote)
    ftp.create_directory("/fs/microsd/mine")
    done = finish(lambda known: ftp.upload_async(str(local), "/fs/microsd/mine", lambda *a: known(*a[:2])))
    assert done[0] == FtpResult.SUCCESS
    assert ftp.are_files_identical(str(local), "/fs/microsd/mine/parameters.json.xz")
    ftp.rename("/fs/microsd/mine/parameters.json.xz", "/fs/microsd/mine/other")
    ftp.remove_file("/fs/microsd/mine/other")
    ftp.remove_directory("/fs/microsd/mine")


def test_mavsdk_finds_the_parameter_metadata(peer: MavsdkPeer) -> None:
    metadata = peer.take("px4").plugin(ComponentMetadata)
    available = StreamedValues()
    metadata.subscribe_metadata_available(available, None)
    metadata.request_autopilot_component()
    update = available.until(lambda found: found.type == MetadataType.PARAMETER)
    described = json.loads(update.json_metadata)
    assert "MIS_TAKEOFF_ALT" in {row["name"] for row in described["parameters"]}
