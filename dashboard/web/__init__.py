"""The operator's page: its HTTP server, and what it sends to browsers (docs/page.md).

`app.make_app` is the application with its `routes`, `services.Services` what they need.
`tables.rows` makes the page's tables of a `Snapshot`; `tables.tables` keeps them for the present
and tells what has changed, `hub` passes that on to browsers.
"""
