"""From meshes, light and a camera to the pixels of a frame."""

from simulation.streetdrive.rendering.camera import Camera
from simulation.streetdrive.rendering.codec import Codec
from simulation.streetdrive.rendering.conditions import CLEAR, Conditions
from simulation.streetdrive.rendering.ground import (
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
from simulation.streetdrive.rendering.lens import Lens
from simulation.streetdrive.rendering.light import Light, draw_light
from simulation.streetdrive.rendering.mesh import Colour, Corner, Material, Mesh, MeshBuilder
from simulation.streetdrive.rendering.painter import Image, Placed, Seen
from simulation.streetdrive.rendering.scenery import (
    Density,
    RoadsideObject,
    paint_objects,
    paint_tree_line,
    paint_tree_shadow,
)
from simulation.streetdrive.rendering.sensor import Sensor, SensorSettings
from simulation.streetdrive.rendering.stage import Backdrop, Occluder, Stage

__all__ = [
    "CLEAR",
    "Backdrop",
    "Camera",
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
    "Placed",
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
