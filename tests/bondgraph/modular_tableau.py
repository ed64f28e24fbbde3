"""The tableau of all bonds modulo a prime: exact solvability, and transfer functions by interpolation in s.

An oracle that shares no code with the reduction, nor with its rank test: every bond has an unknown effort and
flow, every node its equations; each source is a column on the right. Modulo a prime of 61 bits a rank or a
coefficient is wrong by chance alone, with odds of about 1e-15.
"""

from typing import NamedTuple

from flint import nmod_mat, nmod_poly

#: The largest prime below 2^61 - 1, which dynid uses.
PRIME = 2305843009213693921


class Solution(NamedTuple):
    """The equations at one s; `outputs` is None where the output is not determined."""

    solvable: bool
    determined: bool
    outputs: dict


def residue(value):
    return value.numerator * pow(value.denominator, -1, PRIME) % PRIME


def solve(types, values, bonds, output, s):
    """Solve the tableau at one residue s; `outputs` holds T(s) by source where the output is determined."""
    sources = [name for name, kind in types.items() if kind in ("Se", "Sf")]
    unknowns = 2 * len(bonds)
    width = unknowns + len(sources)
    rows = []
    for coefficients in _equations(types, {n: residue(v) for n, v in values.items()}, bonds, s):
        row = [0] * width
        for column, coefficient in coefficients:
            place = unknowns + sources.index(column) if isinstance(column, str) else column
            row[place] = (row[place] + coefficient) % PRIME
        rows.append(row)
    reduced, rank = nmod_mat(len(rows), width, [x for row in rows for x in row], PRIME).rref()
    table = [[int(reduced[r, c]) for c in range(width)] for r in range(rank)]
    leading = [next(c for c, entry in enumerate(row) if entry) for row in table]
    solvable = all(column < unknowns for column in leading)
    place, scale = _unknown(bonds, output, s)
    outputs = None
    if solvable and place in leading:
        row = table[leading.index(place)]
        if not any(row[place + 1 : unknowns]):
            outputs = {name: row[unknowns + k] * scale % PRIME for k, name in enumerate(sources)}
    return Solution(solvable, len(leading) == unknowns, outputs)


def _unknown(bonds, output, s):
    node, quantity = output
    bond = next(index for index, pair in enumerate(bonds) if node in pair)
    return 2 * bond + (quantity in "fq"), pow(s, -1, PRIME) if quantity in "qp" else 1


def _equations(types, values, bonds, s):
    """Yield equations: pairs of a column (effort 2 k, flow 2 k + 1, a source's name) and a coefficient."""
    for name, kind in types.items():
        at = [index for index, bond in enumerate(bonds) if name in bond]
        signs = [1 if bonds[index][1] == name else -1 for index in at]
        if kind in "01":
            first, second = (0, 1) if kind == "0" else (1, 0)
            for index in at[1:]:
                yield [(2 * at[0] + first, 1), (2 * index + first, -1)]
            yield [(2 * index + second, sign) for index, sign in zip(at, signs, strict=True)]
        elif kind in ("Se", "Sf"):
            yield [(2 * at[0] + (kind == "Sf"), 1), (name, 1)]
        elif kind in "RIC":
            size = values[name] * (1 if kind == "R" else s) * signs[0]
            left, right = (1, 0) if kind == "C" else (0, 1)
            yield [(2 * at[0] + left, 1), (2 * at[0] + right, -size)]
        else:
            one, two = (2 * k for k in (at if signs[0] == 1 else reversed(at)))
            pairs = [(one, two), (two + 1, one + 1)] if kind == "TF" else [(one, two + 1), (two, one + 1)]
            for left, right in pairs:
                yield [(left, 1), (right, -values[name])]


def transfer(types, values, bonds, output, rng):
    """Return {source: (numerator, denominator)} modulo the prime, in lowest terms, the latter monic.

    The output is determined; it is sampled at as many s as fix a rational function of the number of storages.
    """
    degree = sum(kind in ("I", "C") for kind in types.values()) + 1
    points, samples = [], []
    while len(points) < 2 * degree + 3:
        s = rng.randrange(1, PRIME)
        found = solve(types, values, bonds, output, s).outputs
        if found is not None:
            points.append(s)
            samples.append(found)
    return {
        source: _rational(points, [sample[source] for sample in samples], degree) for source in samples[0]
    }


def _rational(points, values, degree):
    """Return the rational function of that degree, at most, through points (Cauchy interpolation)."""
    whole, interpolant = nmod_poly([1], PRIME), nmod_poly([0], PRIME)
    for x, y in zip(points, values, strict=True):  # Newton's form
        step = (y - int(interpolant(x))) * pow(int(whole(x)), -1, PRIME) % PRIME
        interpolant += whole * nmod_poly([step], PRIME)
        whole *= nmod_poly([-x % PRIME, 1], PRIME)
    before, now = whole, interpolant
    old, new = nmod_poly([0], PRIME), nmod_poly([1], PRIME)
    while now.degree() > degree:
        quotient, rest = divmod(before, now)
        before, now, old, new = now, rest, new, old - quotient * new
    common = now.gcd(new)
    numerator, denominator = now // common, new // common
    lead = nmod_poly([pow(int(denominator[denominator.degree()]), -1, PRIME)], PRIME)
    return numerator * lead, denominator * lead
