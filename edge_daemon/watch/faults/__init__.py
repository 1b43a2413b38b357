"""One fault of a camera or its clock a module."""
