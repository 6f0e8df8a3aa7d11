"""Calls of actions written in Python: what they raise, with the node where it happened."""

from __future__ import annotations

from collections.abc import Callable

from lgmpc.actions import Action, PythonAction

__all__ = ["watched"]


def watched(call: Callable[[], int], action: Action, first: int) -> Callable[[], int]:
    """Return a call that raises what an action of Python raised in one of its stages; of others, the call itself.

    Args:
        call: evaluates the action at consecutive nodes, once each.
        action: the action.
        first: the first of these nodes.
    """
    if not isinstance(action, PythonAction):
        return call

    def evaluate() -> int:
        action.watch.begin()
        result = call()
        action.watch.raise_at(action.name, first)
        return result

    return evaluate
