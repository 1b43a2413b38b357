"""Sub-commands that the laboratory adds to `slipstream`; lab/pyproject.toml names them."""
