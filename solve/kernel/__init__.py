"""Compiled code: C text, compiled at first use where the machine has a compiler."""
