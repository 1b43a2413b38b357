"""The map in viser's scene: roads, cameras, routes and vehicles, one scene node a layer.

`geometry` and `lanes` compute lines, `shapes` bodies, `canvas` places them in the scene. `fleet`
and `road_map` are the layers that all browsers see, `viewer` what one sees: labels (`labelling`),
what is under its pointer (`marks`) and its selection.
"""

from dashboard.scene.road_map import Drawn, RoadMap
from dashboard.scene.viewer import Viewer

__all__ = ["Drawn", "RoadMap", "Viewer"]
