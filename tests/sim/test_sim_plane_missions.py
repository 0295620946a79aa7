"""An ArduPlane at the end of its mission."""

from station import ALT_M, LAT_DEG, LON_DEG, Station, home_item, scenario, takeoff, waypoint

from sim_vehicle.fleet import Fleet

RTL = "RTL"


def test_an_arduplane_returns_to_launch_after_its_mission() -> None:
    vehicle = {"sysid": 1, "lat_deg": LAT_DEG, "lon_deg": LON_DEG, "alt_amsl_m": ALT_M, "type": "plane"}
    station = Station(Fleet(scenario(vehicles=[vehicle]), ready_s=0.0))
    assert station.upload([home_item(), takeoff(60.0), waypoint(400, 0, 60.0)]) == 0
    assert station.set_mode(10) == 0
    assert station.arm() == 0
    station.until(lambda: station.mode == RTL, 180)
    assert "Mission complete, changing mode to RTL" in station.texts()
