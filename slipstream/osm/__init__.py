"""Road networks from OpenStreetMap extracts: read, completed by law and place, converted by SUMO.

It needs scipy and SUMO's netconvert; PBF files need the extra `osm`.
"""

from slipstream.osm.connected import largest_part
from slipstream.osm.importing import Import, import_osm
