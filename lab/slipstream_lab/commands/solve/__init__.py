"""`slipstream solve`: one instance, one solver, by each form and format."""
