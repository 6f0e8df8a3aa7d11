"""Simulated worlds: the plants, their parameters, sensors, disturbances, and the loop that drives them."""
