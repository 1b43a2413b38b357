"""The operator's web page: vehicles, traffic stability of the watched roads, energy and health.

`daemon.run_dashboard` runs the service with `DashboardSettings`. `feeds` reads bus and database
into `live`; `page` shows the view model of `view` by `scene`, the map, and `panels`. Importing
this package loads neither viser nor the database.
"""

from dashboard.settings import DashboardSettings

__all__ = ["DashboardSettings"]
