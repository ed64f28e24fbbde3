"""The values of columns and of a signal, without their headings."""

from dynid.files import read_measured


def read_columns(*args, **kwargs):
    return read_measured.read_columns(*args, **kwargs).values


def read_signal(*args, **kwargs):
    return read_measured.read_signal(*args, **kwargs)[0]
