"""One kind of record a module."""
