"""Energy of a vehicle alone and in a platoon, and the ledger of what was saved.

Modules are imported by name: an agent takes `traction` without numpy, which `consumption` needs.
"""
