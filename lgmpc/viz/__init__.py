"""Replays and figures. Nothing heavy is imported here: take ``lgmpc.viz.replay`` or ``lgmpc.viz.plots``."""
