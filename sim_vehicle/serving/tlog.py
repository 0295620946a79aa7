"""Telemetry logs in the format of ground stations: each frame follows its time, 8 bytes big-endian [us]."""

import contextlib
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from sim_vehicle.epoch import EPOCH_US
from sim_vehicle.scenarios.model import VehicleSpec
from sim_vehicle.scenarios.script import FrameSink


@contextlib.contextmanager
def tlogs(folder: Path, vehicles: Sequence[VehicleSpec]) -> Iterator[FrameSink]:
    """Open a tlog for each vehicle in `folder`; yield a function that writes a frame to a vehicle's tlog."""
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as files:
        logs = [files.enter_context(_open(folder, spec)) for spec in vehicles]

        def record_frame(index: int, frame: bytes, now: float) -> None:
            logs[index].write(struct.pack(">Q", EPOCH_US + round(now * 1e6)) + frame)

        yield record_frame


def _open(folder: Path, spec: VehicleSpec) -> BinaryIO:
    link = f"link-{spec.link}-" if spec.link else ""
    return (folder / f"{link}vehicle-{spec.sysid}.tlog").open("wb")
