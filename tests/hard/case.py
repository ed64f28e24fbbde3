"""What a hard case is, and how far an answer is from the known one."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import DynidError

SHARED = Path(__file__).parents[2] / "../shared/data"
#: What holds roots: compared one to one, whatever their order.
_ROOTS = ("zeros", "poles", "hidden_modes", "eigenvalues")


@dataclass(frozen=True)
class Refusal:
    """No answer is the right one: the error must match `says`, and tell a remedy that matches `remedy`."""

    says: str
    remedy: str = "."


@dataclass(frozen=True)
class Case:
    """One hard case.

    Parameters
    ----------
    name
        What is hard, unique in the suite.
    half
        Frequency, structure, identification or long run.
    source
        Where the known answer is from; never dynid.
    ask
        Puts the question to dynid's public interface.
    answer
        The known answer, or what gives it: numbers, texts, or a mapping of them; or a `Refusal`. None where
        `ask` compares with it already, and returns how far it is off, in units of what it may be off.
    bound
        Largest relative error; 0 where the answer is exact.
    slow
        Whether it takes seconds.
    needs
        A file that the case reads, where it may be missing.
    """

    name: str
    half: str
    source: str
    ask: Callable[[], Any]
    answer: Any
    bound: float = 0.0
    slow: bool = False
    needs: Path | None = None

    @property
    def refused(self) -> bool:
        """Whether a refusal is the right answer."""
        return isinstance(self.answer, Refusal)

    def error(self) -> float:
        """Return how far dynid's answer is from the known one, relatively."""
        if self.answer is None:
            return float(self.ask())
        known = self.answer() if callable(self.answer) else self.answer
        return distance(self.ask(), known)

    def refusal(self) -> DynidError:
        """Return the error that dynid refuses the case with.

        Raises
        ------
        AssertionError
            Where it answers, or says something else.
        """
        try:
            found = self.ask()
        except DynidError as error:
            if not re.search(self.answer.says, error.problem) or not re.search(
                self.answer.remedy, error.remedy
            ):
                raise AssertionError(f"{self.name} is refused with other words: {error}") from error
            return error
        raise AssertionError(f"{self.name} is answered: {found}")


def distance(found: Any, known: Any, name: str = "") -> float:
    """Return the largest relative distance of what was found from what is known; inf if they differ in kind.

    Parameters
    ----------
    found, known
        Texts, truths, numbers, arrays of them, or mappings.
    name
        What they are called: roots are compared one to one, whatever their order.
    """
    if isinstance(known, Mapping):
        return max(distance(found[key], value, str(key)) for key, value in known.items())
    if isinstance(known, str):
        return 0.0 if re.search(known, str(found)) else np.inf
    found, known = np.asarray(found), np.asarray(known)
    if known.dtype.kind in "bUi" or found.dtype.kind in "bU":
        return 0.0 if found.shape == known.shape and np.all(found == known) else np.inf
    if found.shape != known.shape:
        return np.inf
    if name.rpartition("/")[2] in _ROOTS:
        found = _matched(found, known)
    return _relative(found, known)


def _matched(found: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the found roots in the order of the known ones, each with its nearest that is left."""
    left = list(found)
    order = np.empty(known.shape, dtype=complex)
    for at in np.argsort(np.abs(known)):
        order[at] = left.pop(int(np.argmin(np.abs(np.array(left) - known[at]))))
    return order


def _relative(found: np.ndarray, known: np.ndarray) -> float:
    """Return the largest error of a number, relative to it; of a zero, to the largest of the numbers."""
    with np.errstate(invalid="ignore"):
        off = np.where(found == known, 0.0, np.abs(found - known))
    size = np.where(known == 0, np.abs(known).max(initial=0.0), np.abs(known))
    off, size = np.where(np.isnan(off), np.inf, off), np.where(np.isinf(size), 1.0, size)
    errors = np.divide(off, size, out=np.where(off > 0, np.inf, 0.0), where=size > 0)
    return float(errors.max(initial=0.0))
