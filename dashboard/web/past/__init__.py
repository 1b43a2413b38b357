"""Moments of the kept past as the page shows them: `StoredPast` reads them from the database,
`views` is what it reads, `moment` makes the page's tables of it.
"""

from dashboard.web.past.stored import StoredPast

__all__ = ["StoredPast"]
