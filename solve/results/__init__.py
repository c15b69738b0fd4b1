"""How results leave the program: tables, JSON, pictures and files."""
