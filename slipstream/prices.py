"""What a kilowatt hour costs where nobody has said it."""

from __future__ import annotations

from typing import Final

ENERGY_PRICE_PER_KWH: Final = 0.20
"""EUR: what non-household consumers in the European Union paid on average in the second half of
2023, without VAT (Eurostat, electricity price statistics).
"""
