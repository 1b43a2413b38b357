"""Vehicle shapes as meshes: cars, trucks, buses, motorcycles; `catalogue` builds them by name."""

from slipstream_lab.simulation.streetdrive.vehicles.catalogue import (
    CLASS_OF_SHAPE,
    CLASSES,
    PAINTS,
    build_vehicle,
)

__all__ = ["CLASSES", "CLASS_OF_SHAPE", "PAINTS", "build_vehicle"]
