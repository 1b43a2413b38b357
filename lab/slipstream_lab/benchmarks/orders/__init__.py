"""How soon orders are acknowledged, and placed in plans, between and during cycles."""
