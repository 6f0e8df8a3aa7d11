"""Demonstrations of geometric mechanics: predictions, measurements, figures and scenes."""
