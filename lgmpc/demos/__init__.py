"""Short demonstrations of geometric mechanics: a prediction, a measurement, and pictures of both."""
