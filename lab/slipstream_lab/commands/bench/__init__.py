"""`slipstream bench`: quantum solvers on named instances, devices and published sets."""
