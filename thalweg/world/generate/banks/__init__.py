"""Banks of meadow, reeds or quay: their zones, relief, paint and plants, laid over a valley of forest."""
