"""The values of columns and of a signal, without their headings."""

from dynid.tables import read


def read_columns(*args, **kwargs):
    return read.read_columns(*args, **kwargs).values


def read_signal(*args, **kwargs):
    return read.read_signal(*args, **kwargs)[0]
