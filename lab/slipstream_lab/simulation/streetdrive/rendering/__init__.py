"""From meshes, light and a camera to the pixels of a frame."""

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.codec import Codec
from slipstream_lab.simulation.streetdrive.rendering.conditions import CLEAR, Conditions
from slipstream_lab.simulation.streetdrive.rendering.ground import (
    Grid,
    GroundView,
    Palette,
    band,
    blend,
    lit,
    patches,
    shade_sky,
    verge,
    view_ground,
    worn_asphalt,
    worn_paint,
)
from slipstream_lab.simulation.streetdrive.rendering.lens import Lens
from slipstream_lab.simulation.streetdrive.rendering.light import Light, draw_light
from slipstream_lab.simulation.streetdrive.rendering.mesh import (
    Colour,
    Corner,
    Material,
    Mesh,
    MeshBuilder,
)
from slipstream_lab.simulation.streetdrive.rendering.painter import Image, PlacedMesh, Seen
from slipstream_lab.simulation.streetdrive.rendering.scenery import (
    Density,
    RoadsideObject,
    paint_objects,
    paint_tree_line,
    paint_tree_shadow,
)
from slipstream_lab.simulation.streetdrive.rendering.sensor import Sensor, SensorSettings
from slipstream_lab.simulation.streetdrive.rendering.stage import Backdrop, Occluder, Stage

__all__ = [
    "CLEAR",
    "Backdrop",
    "Codec",
    "Colour",
    "Conditions",
    "Corner",
    "Density",
    "Grid",
    "GroundView",
    "Image",
    "Lens",
    "Light",
    "Material",
    "Mesh",
    "MeshBuilder",
    "Occluder",
    "Palette",
    "PinholeCamera",
    "PlacedMesh",
    "RoadsideObject",
    "Seen",
    "Sensor",
    "SensorSettings",
    "Stage",
    "band",
    "blend",
    "draw_light",
    "lit",
    "paint_objects",
    "paint_tree_line",
    "paint_tree_shadow",
    "patches",
    "shade_sky",
    "verge",
    "view_ground",
    "worn_asphalt",
    "worn_paint",
]
