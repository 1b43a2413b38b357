"""The dispatcher's process: daemon and its parts, HTTP API, intake of orders, alarms, feeds."""
