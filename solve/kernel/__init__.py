"""Compiled code: C files that are compiled at first use, if the machine has a C compiler."""
