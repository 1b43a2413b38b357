"""Solving on other machines by dask.distributed; nothing imports it unless the settings name one.

`client` talks to the cluster, `fallback` puts this machine's processes behind it, `members` are the
scheduler's and the workers' processes, `calls` is what both ends of a call share.
"""
