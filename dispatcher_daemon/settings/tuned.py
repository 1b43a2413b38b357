"""Settings that hold numbers which are no operator's decision."""

from __future__ import annotations

from typing import Any

from slipstream.config import Settings


class TunedSettings(Settings):
    """Fields without a description are constants: no site.toml sets them."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Note the constants."""
        cls.constants = frozenset(
            name for name, field in cls.model_fields.items() if not field.description
        )
