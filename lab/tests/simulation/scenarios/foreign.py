"""A town as others make them: two parts that are not connected, ids with odd characters, a lane and
a road for buses, routes and types of its own in several files, detectors, a SUMO configuration.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

from slipstream.osm.netconvert import find_netconvert

_NODES = {
    "nw#1": (0, 400),
    "ne:1": (600, 400),
    "se-1": (600, 0),
    "sw[1]": (0, 0),
    "mid": (300, 800),
    "far": (3000, 0),
    "farther": (3400, 0),
}
_CONTROL = dict.fromkeys(("nw#1", "se-1"), "traffic_light")
_EDGES = (
    *(("-12#0", "nw#1", "ne:1"), ("12#0", "ne:1", "nw#1")),
    *(("b3[1]", "ne:1", "se-1"), ("-b3[1]", "se-1", "ne:1")),
    *(("7+8", "se-1", "sw[1]"), ("-7+8", "sw[1]", "se-1")),
    *(("left", "sw[1]", "nw#1"), ("-left", "nw#1", "sw[1]")),
    *(("island#1", "far", "farther"), ("-island#1", "farther", "far")),
)
_BUS_ONLY = (("bus#in", "nw#1", "mid"), ("bus#out", "mid", "ne:1"))


def build(folder: Path) -> Path:
    """Write the town's files; returns its configuration."""
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}" type="{_CONTROL.get(name, "priority")}"/>'
        for name, (x, y) in _NODES.items()
    )
    edges = "".join(
        f'<edge id="{name}" from="{start}" to="{end}" numLanes="2" speed="13.9">'
        '<lane index="0" allow="bus"/></edge>'
        if name == "b3[1]"
        else f'<edge id="{name}" from="{start}" to="{end}" numLanes="2" speed="13.9"/>'
        for name, start, end in _EDGES
    )
    edges += "".join(
        f'<edge id="{name}" from="{start}" to="{end}" numLanes="1" speed="13.9" allow="bus"/>'
        for name, start, end in _BUS_ONLY
    )
    (folder / "t.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "t.edg.xml").write_text(f"<edges>{edges}</edges>")
    plain = ("--node-files", folder / "t.nod.xml", "--edge-files", folder / "t.edg.xml")
    net = ("--output-file", folder / "town.net.xml")
    subprocess.run([str(find_netconvert()), *map(str, (*plain, *net))], check=True)
    cars = "".join(
        f'<trip id="car#{i}" type="pkw" depart="{3600 + 12 * i}" from="{way[0]}" to="{way[1]}"/>'
        for i, way in enumerate(45 * (("-12#0", "7+8"), ("-7+8", "12#0")))
    )
    (folder / "cars.rou.xml").write_text(f"<routes>{cars}</routes>")
    (folder / "others.rou.xml").write_text(
        '<routes><vType id="linie" vClass="bus"/><route id="island" edges="island#1 -island#1"/>'
        '<flow id="i" type="pkw" route="island" begin="3600" end="4700" number="60"/>'
        '<vehicle id="bus" type="linie" depart="3700">'
        '<route edges="left bus#in bus#out b3[1]"/></vehicle></routes>'
    )
    (folder / "types.add.xml").write_text(
        '<additional><vType id="pkw" vClass="passenger" sigma="0.5"/></additional>'
    )
    (folder / "detectors.add.xml").write_text(
        '<additional><e1Detector id="d" lane="7+8_0" pos="10" period="60" file="out.xml"/>'
        "</additional>"
    )
    configuration = folder / "town.sumocfg"
    configuration.write_text(
        '<configuration><input><net-file value="town.net.xml"/>'
        '<route-files value="cars.rou.xml,others.rou.xml"/>'
        '<additional-files value="types.add.xml, detectors.add.xml"/></input>'
        '<time><begin value="1:00:00"/><end value="4200"/></time>'
        '<processing><time-to-teleport value="60"/></processing>'
        '<output><tripinfo-output value="trips.xml"/></output></configuration>'
    )
    return configuration
