"""Physical domains and their SI units."""

from __future__ import annotations

import re

#: SI units by domain: of effort e, flow f, displacement q (the integral of f), momentum p (that of e).
#: `mechanical` is translation; thermal: temperature and heat flow, a pseudo bond graph.
UNITS: dict[str, dict[str, str]] = {
    "mechanical": {"e": "N", "f": "m/s", "q": "m", "p": "N.s"},
    "rotational": {"e": "N.m", "f": "rad/s", "q": "rad", "p": "N.m.s"},
    "electrical": {"e": "V", "f": "A", "q": "A.s", "p": "V.s"},
    "magnetic": {"e": "A", "f": "V", "q": "V.s", "p": "A.s"},
    "hydraulic": {"e": "Pa", "f": "m3/s", "q": "m3", "p": "Pa.s"},
    "acoustic": {"e": "Pa", "f": "m3/s", "q": "m3", "p": "Pa.s"},
    "thermal": {"e": "K", "f": "W", "q": "J", "p": "K.s"},
}
_FACTOR = re.compile(r"([A-Za-z]+)(\d*)")


def quotient(above: str, below: str) -> str:
    """Return the unit of a quotient: `m/s` over `N` is `m/(N.s)`; `1` where nothing is left."""
    powers: dict[str, int] = {}
    for text, sign in ((above, 1), (below, -1)):
        for part, way in zip(text.split("/"), (sign, -sign), strict=False):
            for name, power in _FACTOR.findall(part):
                powers[name] = powers.get(name, 0) + way * int(power or 1)
    top = [_power(name, power) for name, power in powers.items() if power > 0]
    under = [_power(name, -power) for name, power in powers.items() if power < 0]
    if not under:
        return ".".join(top) or "1"
    bottom = ".".join(under)
    return f"{'.'.join(top) or '1'}/{f'({bottom})' if len(under) > 1 else bottom}"


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}{power}"
