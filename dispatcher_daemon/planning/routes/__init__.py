"""Routes without platooning: order of stops, ways, breaks, charging (PyVRP)."""
