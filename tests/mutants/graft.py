"""Putting a wrong into a module that is loaded already, in the memory of this process alone."""

from __future__ import annotations

import functools
import gc
import sys
from types import FunctionType

from tests.mutants.operators import Mutant, mutated


def graft(mutant: Mutant, path: str, source: str) -> None:
    """Let every function of a module, whoever has imported it, do what it does in the mutated one.

    Raises
    ------
    Exception
        Whatever the mutated module raises when it is loaded.
    """
    module = sys.modules[mutant.module]
    new = {name: getattr(module, name) for name in ("__name__", "__package__", "__file__", "__spec__")}
    exec(compile(mutated(source, mutant.number), path, "exec"), new)
    for name in mutant.names:
        old = vars(module)[name]
        for other in list(sys.modules.values()):
            if getattr(other, "__dict__", {}).get(name) is old:
                setattr(other, name, new[name])
    for name, value in new.items():
        if getattr(value, "__module__", None) == mutant.module:
            _into(vars(module).get(name), value)
    for cached in gc.get_objects():
        if isinstance(cached, functools._lru_cache_wrapper):
            cached.cache_clear()


def _into(old: object, new: object) -> None:
    if isinstance(old, FunctionType) and isinstance(new, FunctionType):
        if "__wrapped__" in vars(old):
            _into(old.__wrapped__, new.__wrapped__)
        elif old.__code__ != new.__code__ or old.__defaults__ != new.__defaults__:
            old.__code__, old.__defaults__, old.__kwdefaults__ = (
                new.__code__,
                new.__defaults__,
                new.__kwdefaults__,
            )
        else:
            old.__kwdefaults__ = new.__kwdefaults__
    elif isinstance(old, type) and isinstance(new, type):
        for name, value in vars(new).items():
            _into(vars(old).get(name), value)
    else:
        for inner in ("fget", "func", "__func__", "__wrapped__"):
            if hasattr(old, inner) and hasattr(new, inner):
                _into(getattr(old, inner), getattr(new, inner))
