"""Matrices out of users' files, one format a file; which one, the extension and the header say."""
