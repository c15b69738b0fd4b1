"""Systems from matrices of other tools. Files are data: nothing in them is executed."""
