"""Runs that a page in the browser shows and drives while they go on.

The loop's process paces the simulation and writes pictures into a ring of shared memory
(:mod:`lgmpc.live.ring`); a process of its own serves the page (:mod:`lgmpc.live.viewer`, with viser) and sends back
what the user asks for (:mod:`lgmpc.live.wishes`). The loop never waits for the page, and survives it.
"""

from lgmpc.live.running import Viewing, live_config, viewed_config

__all__ = ["Viewing", "live_config", "viewed_config"]
