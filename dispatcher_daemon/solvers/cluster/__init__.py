"""Solving on other machines by dask.distributed; nothing imports it unless the settings name one.

- `client`: the dispatcher's end; `fallback` puts this machine's processes behind it
- `connection`, `arrays`, `security`: connecting, what was sent already, TLS
- `calls`: both ends of a call
- `members`: the processes of the scheduler and of the workers
"""

from __future__ import annotations

from dispatcher_daemon.solvers.cluster.calls import CallFailed, ClusterLost
from dispatcher_daemon.solvers.cluster.client import Cluster
from dispatcher_daemon.solvers.cluster.fallback import ClusterExecutor, cluster_solve

__all__ = ["CallFailed", "Cluster", "ClusterExecutor", "ClusterLost", "cluster_solve"]
