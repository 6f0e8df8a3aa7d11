"""Gaits, footholds, swings and commands: what a legged robot does with its feet, and when."""
