"""The page's tables of the present."""
