"""Robots: equations of motion derived from energies, centroidal momentum."""
