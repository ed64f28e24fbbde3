"""Machine code of the innermost loops: a library of plain C, without Python's interface, called by ctypes.

It is compiled when the package is built (`hatch_build.py`) and loads in a fraction of a millisecond. Where it
is absent, as in a source tree that was not installed, NumPy does the same. The environment variable
DYNID_COMPILED is 0 (never), 1 (always: an error where the library is absent) or auto (default).
"""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from numpy.typing import NDArray

from dynid.errors import UsageError

if TYPE_CHECKING:
    import ctypes
    from pathlib import Path

Array: TypeAlias = NDArray[Any]

VARIABLE = "DYNID_COMPILED"
#: The version of the functions' arguments, as in `abi.c`: a library of another one is not used.
ABI = 12
_NO_MEMORY = -(2**63)


def compiled(function: str = "") -> bool:
    """Return True if the library is to be used, and has a function, which an older one may lack.

    Raises
    ------
    UsageError
        If the environment variable has another value, or asks for a library that is absent.
    """
    wish = os.environ.get(VARIABLE, "auto")
    if wish not in ("0", "1", "auto"):
        raise UsageError(f"{VARIABLE} is {wish!r}", remedy="Set it to 0, 1 or auto.", names=(VARIABLE,))
    if wish == "1" and found() is None:
        raise UsageError(
            f"{VARIABLE} is 1, but dynid was installed without its library",
            remedy="Install it again where there is a C compiler, or set it to auto.",
            names=(VARIABLE,),
        )
    return wish != "0" and found() is not None and (not function or hasattr(found(), function))


@cache
def found() -> ctypes.CDLL | None:
    """Return the library, or None where it is absent or made for another version."""
    from pathlib import Path

    folder = Path(__file__).parent
    plain = next((made for path in folder.glob("library.plain.*") if (made := _loaded(path))), None)
    wide = plain.dynid_wide() if plain is not None else 0
    for name in ("avx512", "avx2")[2 - wide :]:  # the widest that the processor has
        for path in folder.glob(f"library.{name}.*"):
            if (made := _loaded(path)) is not None:
                return made
    return plain


def _loaded(path: Path) -> ctypes.CDLL | None:
    import ctypes

    try:
        made = ctypes.CDLL(str(path))
        return made if made.dynid_abi() == ABI else None
    except (OSError, AttributeError):  # of another machine, or no library
        return None


def structure(**members: int | float | Array | None) -> Any:
    """Return a C structure of 64-bit members in this order; it keeps the arrays that it points to alive."""
    given = [member if isinstance(member, int | float) else _address(member) for member in members.values()]
    made = _layout(tuple(members), tuple(map(type, given)))(*given)
    made.kept = members
    return made


@cache
def _layout(names: tuple[str, ...], types: tuple[type, ...]) -> Any:
    import ctypes

    kinds = [ctypes.c_double if each is float else ctypes.c_int64 for each in types]
    return type("Members", (ctypes.Structure,), {"_fields_": list(zip(names, kinds, strict=True))})


def _address(array: Array | None) -> int:
    import ctypes

    if array is None:
        return 0
    if not array.flags.c_contiguous:
        raise ValueError("an array for the library must be contiguous")
    if array.flags.writeable and array.size:  # three times as fast as the attribute
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return array.ctypes.data


@cache
def _function(name: str) -> Any:
    """Return a function of the library, which returns a 64-bit integer."""
    import ctypes

    function = getattr(found(), name)
    function.restype = ctypes.c_int64
    return function


def call(name: str, *arguments: Any) -> int:
    """Call a function of the library with structures, arrays (None: absent), integers and floats.

    Raises
    ------
    MemoryError
        If the function returns the least integer, which says that there is no memory.
    """
    import ctypes

    function = _function(name)
    given: list[Any] = []
    for each in arguments:
        if isinstance(each, ctypes.Structure):
            given.append(ctypes.byref(each))
        elif isinstance(each, float):
            given.append(ctypes.c_double(each))
        else:
            given.append(ctypes.c_int64(each if isinstance(each, int) else _address(each)))
    returned: int = function(*given)
    if returned == _NO_MEMORY:
        raise MemoryError("the library has no memory left")
    return returned
