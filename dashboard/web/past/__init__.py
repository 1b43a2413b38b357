"""Moments of the kept past as the page shows them: `StoredPast` reads them from the database,
`facts` is what it reads, `views` and `moment` make the page's tables of it.
"""

from dashboard.web.past.stored import StoredPast

__all__ = ["StoredPast"]
