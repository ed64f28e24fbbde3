"""Users' files: matrices, meshes, nodes, tables and Universal Files.

`read_matrix`, `read_mesh`, `read_structure` and `read_measured` are what the rest of the package calls.
`formats` lists the file formats; each has a module. `untrusted` has the checks of files of unknown origin.
A file that cannot be read, is damaged, or holds something else is a `FileError`, whoever reads it.
"""
