"""Compiled code: C files that are compiled when they are first used, if the machine has a C compiler."""
