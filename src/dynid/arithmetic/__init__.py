"""Safe arithmetic: exact expressions of numbers and names; nothing is ever executed."""
