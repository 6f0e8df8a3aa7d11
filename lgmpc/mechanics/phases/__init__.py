"""Geometric phases: rotation by changes of shape, and the phase of a free rigid body (chapter 4.16).

Half a turn of a cat about its spine, without angular momentum::

    cat = Cat()
    cat.connection().holonomy(flip(cat.flipping_bend()))
"""
