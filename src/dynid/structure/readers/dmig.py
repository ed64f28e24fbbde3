"""DMIG matrices of Nastran bulk data, as EXTSEOUT punches them, with the labels of their DOFs.

Source: MSC Nastran Quick Reference Guide, "DMIG".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dynid.structure.readers.bulk_cards import WHAT, Card, read_cards, whole
from dynid.structure.readers.bulk_data import component_labels
from dynid.structure.readers.imported_matrix import ImportedMatrix, read_errors
from dynid.structure.readers.program_text import real


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the DMIG matrices of a file, by name."""
    with read_errors(path, WHAT):
        found = _dmig(read_cards(path, {"DMIG"}))
        return {name: matrix.matrix.shape for name, matrix in found.items()}


def load(path: Path, name: str) -> ImportedMatrix:
    """Return one DMIG matrix of a file, with the labels of its DOFs."""
    with read_errors(path, WHAT):
        return _dmig(read_cards(path, {"DMIG"}))[name]


def _dmig(cards: Mapping[str, Sequence[Card]]) -> dict[str, ImportedMatrix]:
    """Return the square real matrices of DMIG cards by name.

    A column is ``name, node, component, (blank)``, then ``node, component, A, B`` of each entry; a card of a
    name with 0 as node says the form and the type.
    """
    heads: dict[str, Card] = {}
    entries: dict[str, list[tuple[int, int, int, int, float]]] = {}
    for card in cards.get("DMIG", ()):
        name, column = card[1].upper(), whole(card[2])
        if column == 0:
            heads[name] = card
            continue
        rows = entries.setdefault(name, [])
        at = (column, whole(card[3] or "0"))
        for k in range(5, len(card) - 2, 4):
            if card[k]:
                rows.append((*at, whole(card[k]), whole(card[k + 1] or "0"), real(card[k + 2])))
    found = {}
    for name, rows in entries.items():
        form, kind = (whole(heads[name][k] or "1") for k in (3, 4)) if name in heads else (1, 2)
        if kind in (1, 2) and form in (1, 6) and rows:
            found[name] = _labelled(rows, symmetric=form == 6)
    return found


def _labelled(rows: Sequence[tuple[int, int, int, int, float]], *, symmetric: bool) -> ImportedMatrix:
    from scipy.sparse import coo_array  # heavy import, needed here only

    ends = np.array([row[:4] for row in rows])
    values = np.array([row[4] for row in rows])
    dofs, inverse = np.unique(np.concatenate([ends[:, 2:], ends[:, :2]]), axis=0, return_inverse=True)
    i, j = inverse.reshape(2, -1)
    n = len(dofs)
    if symmetric:  # one of two mirrored entries is there, or both
        lone = (i != j) & ~np.isin(j * n + i, i * n + j)
        i, j, values = (np.concatenate(pair) for pair in ((i, j[lone]), (j, i[lone]), (values, values[lone])))
    labels = tuple(component_labels(node, str(component))[0] for node, component in dofs.tolist())
    return ImportedMatrix(coo_array((values, (i, j)), shape=(n, n)).tocsc(), labels)
