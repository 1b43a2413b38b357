"""The map in viser's scene: roads, cameras, routes and vehicles, one scene node a layer.

`geometry` and `lanes` compute lines, `canvas` draws them, `fleet` and `road_map` are the layers.
"""

from dashboard.scene.road_map import RoadMap

__all__ = ["RoadMap"]
