"""Runs that a page in the browser shows and drives while they go on.

The loop's process paces the simulation (:mod:`lgmpc.live.session`), or is clocked by a robot at the end of a link
(:mod:`lgmpc.live.deployed`). It writes pictures into a ring of shared memory (:mod:`lgmpc.live.ring`); a process of its
own serves the page (:mod:`lgmpc.live.viewing`, with viser) and sends back what the user asks for
(:mod:`lgmpc.live.wishes`). The loop never waits for the page, and survives it::

    with Viewing().open(print) as link:                     # lgmpc.live.viewing
        live_config(load_config("solo12_velocity"), link)   # lgmpc.live.session

Nothing is imported here: the page is open before the rest is loaded.
"""
