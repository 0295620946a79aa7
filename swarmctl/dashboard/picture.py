"""The types of what the dashboard shows at one time. Pure data.

East and north are metres in the local frame of the area (`Grid.frame`): the origin is the south-west corner.
Cells are (row, col); row 0 is the south edge. `time_s` is the run's clock.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.dashboard.history import Grown

SourceKind = Literal["recording", "live file", "bus", "abstract mission"]
Severity = Literal["info", "warning", "alarm"]
MapPoint = tuple[float, float]
"""east, north [m]"""
CellCodes = NDArray[np.uint8]
"""(rows, cols) of UNSEEN, or SEEN with OCCUPIED and OWN added"""

UNSEEN, SEEN, OCCUPIED, OWN = 0, 1, 2, 4
"""bits of a cell's code: seen by any vehicle, believed occupied, seen by the vehicle itself"""
SILENT_AFTER_S = 5.0
"""time without a word after which a vehicle counts as silent"""


class AreaPicture(msgspec.Struct, frozen=True):
    """The constant part: the area, the goals, and the swarm."""

    swarm: str
    rows: int
    cols: int
    cell_size_m: float
    corners: tuple[LatLon, ...]
    """south-west, south-east, north-east and north-west corner [deg]"""
    goals: tuple[Cell, ...]
    no_fly: tuple[Cell, ...]
    fence: tuple[MapPoint, ...]
    """corners in order; empty: no fence is known"""
    hostiles: tuple[Cell, ...] | None
    """true cells of the hostiles; None if nothing simulates them"""
    names: tuple[str, ...]
    """names of the vehicles, in the order of their colours"""
    colours: tuple[str, ...]
    """colour of each vehicle as #rrggbb, as in the pictures of the report"""
    simulated: tuple[bool, ...]
    """True for each vehicle that the simulator plays"""


class SourceState(msgspec.Struct, frozen=True):
    """The state of the source, and the limits of its knowledge."""

    kind: SourceKind
    is_live: bool
    """True while new data may come"""
    end_s: float
    """last time that can be shown, by the run's clock [s]"""
    total_s: float
    """length of the record, as far as known; above `end_s` while the record is still being read"""
    age_s: float
    """age of the newest data of a live source [s]"""
    text: str
    """state of the connection or of the file in words, for the operator; empty: nothing to tell"""
    lacks: tuple[str, ...]
    """kinds of data that this source does not have, in words"""


class ShownRoute(msgspec.Struct, frozen=True):
    """A planned route."""

    plan_id: int
    cells: tuple[Cell, ...]
    """cells below the route"""
    points: tuple[MapPoint, ...]
    """flown points with the landing"""
    length_m: float
    exposure_sum: float
    """ΣP_s by the belief at the decision"""
    safety_factor: float
    """∏(1 − P_s) by the belief at the decision"""

    def __str__(self) -> str:
        return f"{self.length_m:.0f} m, ΣP_s {self.exposure_sum:.3f}, ∏(1 − P_s) {self.safety_factor:.3f}"


class Learned(msgspec.Struct, frozen=True):
    """An observation that led to a change of a route."""

    observer: str
    """name of the vehicle that observed"""
    observed_s: float | None
    """time of the observation by the run's clock [s]; None: not known"""


class RouteChange(msgspec.Struct, frozen=True):
    """A new plan of a vehicle: both routes, and what the vehicle had learned."""

    time_s: float
    vehicle: str
    old: ShownRoute | None
    """route flown before; None for the first route"""
    new: ShownRoute
    because: tuple[Learned, ...]


class Hearing(msgspec.Struct, frozen=True):
    """The receiver hears the sender."""

    sender: str
    receiver: str
    age_s: float
    """time since the receiver last reported to hear the sender, or got a message of it [s]"""
    loss: float | None
    """share of the sender's messages that did not arrive, over the last minute; None: not known"""


class Conflict(msgspec.Struct, frozen=True):
    """A predicted conflict: two vehicles come too close in space and time."""

    vehicles: tuple[str, str]
    in_s: float
    """time until the least distance [s]"""
    at: MapPoint
    """place of the first vehicle at that time"""


class Group(msgspec.Struct, frozen=True):
    """Vehicles that fly together in a formation."""

    name: str
    members: tuple[str, ...]
    """members that are present, in the order of their places"""
    leader: str
    errors_m: tuple[int | None, ...]
    """distance of each member from its place [m]; None: not known"""


class Strike(msgspec.Struct, frozen=True):
    time_s: float
    vehicle: str
    at: MapPoint
    count: int


class Event(msgspec.Struct, frozen=True):
    """A line of the event list. Alarms stay until an operator acknowledges them."""

    number: int
    """running number, from 1; the acknowledgement names it"""
    time_s: float
    vehicle: str
    """empty: the whole swarm"""
    severity: Severity
    text: str


class VehiclePicture(msgspec.Struct, frozen=True):
    """A vehicle at one time; None for a value that is not known."""

    name: str
    phase: str
    """phase of the agent; empty before the first word"""
    mode: str
    position: MapPoint | None
    height_m: float | None
    """above home [m]"""
    speed_m_s: float | None
    """over ground [m/s]"""
    heading_deg: float | None
    """course over ground, or the heading of a slow vehicle [deg]"""
    battery_percent: int | None
    progress: float | None
    """share of the route, 0..1"""
    arrives_in_s: float | None
    """predicted time to the last waypoint [s]"""
    link: str
    """quality of the link in words, as in the terminal"""
    age_s: float | None
    """time since the last word of the vehicle [s]; None before the first"""
    is_silent: bool
    """True if the last word is older than SILENT_AFTER_S, or there was none: the vehicle may have moved on"""
    cells_known: int
    hostiles_known: int
    replans: int
    strikes: int | None
    waiting: str
    """what the vehicle waits for, in words; empty: for nothing"""
    note: str
    """alarm, outcome or trouble in words, as in the terminal"""
    route: ShownRoute | None
    """plan that is flown"""
    track: Grown[MapPoint]
    """flown track"""


class Picture(msgspec.Struct, frozen=True):
    """Everything that the page shows at one time, besides the constant `AreaPicture`."""

    time_s: float
    source: SourceState
    vehicles: tuple[VehiclePicture, ...]
    """in the order of `AreaPicture.names`"""
    whose: str
    """name of the vehicle with the belief that is shown; empty: what all vehicles together know"""
    belief: CellCodes
    hearing: tuple[Hearing, ...]
    conflicts: tuple[Conflict, ...]
    events: Grown[Event]
    """all events up to `time_s`, in order"""
    changes: Grown[RouteChange]
    strikes: Grown[Strike]
    groups: tuple[Group, ...]
