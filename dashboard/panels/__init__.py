"""The panel beside the map: headline, troubles and key, and the card of a selection."""
