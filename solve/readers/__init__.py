"""Systems from matrices of other programs. The files are data; their content is not executed."""
