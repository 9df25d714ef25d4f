"""Callbacks that do not keep alive whose they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec
from weakref import WeakMethod

Given = ParamSpec("Given")


def weakly(method: Callable[Given, None]) -> Callable[Given, None]:
    """A function that calls a method of an object as long as somebody else keeps the object.

    What looks on at a world refers to the world. If the world referred back, both, with all models
    and pictures, would stay in memory until Python looks for circles, which is late: a run has few
    objects, and large ones.

    Args:
        method: Method, bound to its object.
    """
    reference = WeakMethod(method)

    def call(*given: Given.args, **named: Given.kwargs) -> None:
        alive = reference()
        if alive is not None:
            alive(*given, **named)

    return call
