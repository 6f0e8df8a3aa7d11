"""Simulated worlds: the plants, their parameters, disturbances, and the loop that drives them."""
