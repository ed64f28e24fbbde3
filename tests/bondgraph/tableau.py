"""An independent oracle: every bond has an unknown effort and flow, every node its equations.

It shares no code with the reduction: node types and bonds go in as plain text, and the linear system is
solved over the rationals at one rational value of s.
"""

from fractions import Fraction

from flint import fmpq, fmpq_mat


def transfer_at(types, values, bonds, inputs, output, s):
    """Return {input: T(s)} for output (node, quantity), or None where the tableau is singular."""
    rows, rights = _equations(types, values, bonds, inputs, s)
    try:
        solution = _matrix(rows).solve(_matrix(rights))
    except ZeroDivisionError:
        return None
    row, scale = _unknown(bonds, output, s)
    return {name: _fraction(solution[row, k]) * scale for k, name in enumerate(inputs)}


def transfers_at(types, values, bonds, inputs, outputs, s):
    """Return {(output, input): T(s)} for several outputs, named as ports, or None where it is singular."""
    rows, rights = _equations(types, values, bonds, inputs, s)
    try:
        solution = _matrix(rows).solve(_matrix(rights))
    except ZeroDivisionError:
        return None
    found = {}
    for output in outputs:
        row, scale = _unknown(bonds, output, s)
        for k, name in enumerate(inputs):
            found[".".join(output), name] = _fraction(solution[row, k]) * scale
    return found


def determined_at(types, values, bonds, inputs, output, s):
    """Return {input: T(s)} where the equations determine the output although they may be singular elsewhere.

    None where they leave the output open; an input under which they have no solution is left out.
    """
    rows, rights = _equations(types, values, bonds, inputs, s)
    unknown, scale = _unknown(bonds, output, s)
    found = {}
    for k, name in enumerate(inputs):
        reduced, rank = _matrix([[*row, right[k]] for row, right in zip(rows, rights, strict=True)]).rref()
        table = [[_fraction(reduced[r, c]) for c in range(len(rows[0]) + 1)] for r in range(rank)]
        leading = [next(c for c, entry in enumerate(row) if entry) for row in table]
        if len(rows[0]) in leading:
            continue
        if unknown not in leading:
            return None
        solved = table[leading.index(unknown)]
        if any(solved[unknown + 1 : -1]):
            return None
        found[name] = solved[-1] * scale
    return found


def determinant_at(types, values, bonds, s):
    """Return the determinant of all equations, every source at zero: it vanishes at the natural modes."""
    rows, _ = _equations(types, values, bonds, [], s)
    if len(rows) > 2 * len(bonds):  # a junction without a bond: its balance says 0 = 0, its variable is free
        return Fraction(0)
    return _fraction(_matrix(rows).det())


def _unknown(bonds, output, s):
    """Return the column of a variable, and what to multiply it by."""
    node, quantity = output
    bond = next(index for index, pair in enumerate(bonds) if node in pair)
    return 2 * bond + (quantity in "fq"), 1 / s if quantity in "qp" else Fraction(1)


def _matrix(table):
    return fmpq_mat([[fmpq(x.numerator, x.denominator) for x in row] for row in table])


def _fraction(number):
    return Fraction(int(number.p), int(number.q))


def _equations(types, values, bonds, inputs, s):
    unknowns = 2 * len(bonds)
    rows, rights = [], []

    def equation(coefficients, source=None):
        row = [Fraction(0)] * unknowns
        for column, coefficient in coefficients:
            row[column] += Fraction(coefficient)
        rows.append(row)
        rights.append([Fraction(int(source == name)) for name in inputs])

    def e(bond):
        return 2 * bond

    def f(bond):
        return 2 * bond + 1

    for name, kind in types.items():
        at = [index for index, bond in enumerate(bonds) if name in bond]
        signs = [1 if bonds[index][1] == name else -1 for index in at]
        if kind in "01":
            same, balanced = (e, f) if kind == "0" else (f, e)
            for index in at[1:]:
                equation([(same(at[0]), 1), (same(index), -1)])
            equation([(balanced(index), sign) for index, sign in zip(at, signs, strict=True)])
        elif kind == "Se":
            equation([(e(at[0]), 1)], name)
        elif kind == "Sf":
            equation([(f(at[0]), 1)], name)
        elif kind == "R":
            equation([(e(at[0]), 1), (f(at[0]), -values[name] * signs[0])])
        elif kind == "I":
            equation([(e(at[0]), 1), (f(at[0]), -values[name] * s * signs[0])])
        elif kind == "C":
            equation([(f(at[0]), 1), (e(at[0]), -values[name] * s * signs[0])])
        elif kind == "A":  # reads the common variable before it, takes no power, drives the balance behind it
            (one,) = (index for index in at if bonds[index][1] == name)
            (two,) = (index for index in at if bonds[index][0] == name)
            (read, none) = (e, f) if types[bonds[one][0]] == "0" else (f, e)
            driven = f if types[bonds[two][1]] == "0" else e
            equation([(none(one), 1)])
            equation([(driven(two), 1), (read(one), -values[name])])
        elif kind == "law":  # values: linear equations, each a list of (bond, quantity, coefficient at s)
            for terms in values[name]:
                equation(
                    [(2 * bond + (quantity in "fq"), coefficient) for bond, quantity, coefficient in terms]
                )
        elif kind in ("MI", "MC", "MR"):  # values: the matrix of a field, its ports; power is positive inward
            matrix, ports = values[name]
            bond = {end: index for index, pair in enumerate(bonds) for end in pair}
            inward = {port: 1 if bonds[bond[port]][1] == port else -1 for port in ports}
            factor = Fraction(1) if kind == "MR" else s
            for port, entries in zip(ports, matrix, strict=True):
                if kind == "MC":
                    terms = [(e(bond[other]), -factor * y) for other, y in zip(ports, entries, strict=True)]
                    equation([(f(bond[port]), inward[port]), *terms])
                else:
                    terms = [
                        (f(bond[other]), -factor * z * inward[other])
                        for other, z in zip(ports, entries, strict=True)
                    ]
                    equation([(e(bond[port]), 1), *terms])
        elif kind in ("MTF", "MGY"):  # values: moduli, ports of the rows, ports of the columns
            moduli, first, second = values[name]
            bond = {end: index for index, pair in enumerate(bonds) for end in pair}
            over, under = (e, f) if kind == "MTF" else (f, e)
            for port, entries in zip(first, moduli, strict=True):
                terms = [(over(bond[other]), -n) for other, n in zip(second, entries, strict=True)]
                equation([(e(bond[port]), 1), *terms])
            for port, entries in zip(second, zip(*moduli, strict=True), strict=True):
                terms = [(f(bond[other]), -n) for other, n in zip(first, entries, strict=True)]
                equation([(under(bond[port]), 1), *terms])
        else:
            one, two = (at[0], at[1]) if signs[0] == 1 else (at[1], at[0])
            if kind == "TF":
                equation([(e(one), 1), (e(two), -values[name])])
                equation([(f(two), 1), (f(one), -values[name])])
            else:
                equation([(e(one), 1), (f(two), -values[name])])
                equation([(e(two), 1), (f(one), -values[name])])
    return rows, rights


def solvable_at(types, values, bonds, s):
    """Return whether the equations have a solution whatever each source prescribes, unique or not."""
    sources = [name for name, kind in types.items() if kind in ("Se", "Sf")]
    rows, rights = _equations(types, values, bonds, sources, s)
    joined = [[*row, *right] for row, right in zip(rows, rights, strict=True)]
    return _matrix(rows).rank() == _matrix(joined).rank()
