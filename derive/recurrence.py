"""Calls in generated code that evaluate Fourier series, all orders at one argument together."""

from collections.abc import Mapping, Sequence
from typing import Any

import sympy

from derive.printer import CasadiPrinter
from derive.symbols import nesting, unused_symbol
from derive.transmission import PeriodicFunction

FOURIER = '''\
def _fourier(angle, mean, cosine, sine, orders):
    """Derivatives of the given orders of mean + sum of a_k cos kx + b_k sin kx, k = 1, 2, ...

    Order -1 is the integral of zero mean. Cosines and sines follow from those of x by angle addition.
    """
    cos_x, sin_x = casadi.cos(angle), casadi.sin(angle)
    cos_kx, sin_kx = 1.0, 0.0
    sums = [mean if order == 0 else 0.0 for order in orders]
    for k, (a, b) in enumerate(zip(cosine, sine), 1):
        cos_kx, sin_kx = cos_kx * cos_x - sin_kx * sin_x, sin_kx * cos_x + cos_kx * sin_x
        even, odd = a * cos_kx + b * sin_kx, b * cos_kx - a * sin_kx
        for i, order in enumerate(orders):
            sums[i] += float(k) ** order * (even, odd, -even, -odd)[order % 4]
    return sums'''
COMPONENTS = '''\
def _components(amplitudes, angles):
    """Cosine and sine coefficients of a sum of A cos(kx + angle)."""
    pairs = list(zip(amplitudes, angles))
    return [a * casadi.cos(g) for a, g in pairs], [-a * casadi.sin(g) for a, g in pairs]'''


def series_calls(
    matrices: Sequence[sympy.Matrix], taken: set[str]
) -> tuple[list[str], dict[PeriodicFunction, sympy.Symbol]]:
    """Lines that evaluate every series in the matrices, and the symbol that holds each value.

    `taken` are names that the symbols must not have; the new ones are added to it.
    """
    direct: set[Any] = set().union(*(matrix.atoms(PeriodicFunction) for matrix in matrices))
    inner = {inside for each in direct for inside in each.args[0].atoms(PeriodicFunction)}
    together: dict[tuple[type[PeriodicFunction], Any], set[int]] = {}
    for each in direct | inner:
        together.setdefault((type(each), each.args[0]), set()).add(each.order)
    lines, values = [], {}
    for series, argument in sorted(together, key=_inner_first):
        orders = sorted(together[series, argument])
        symbols = [unused_symbol(f"{series.__name__}_{order}", taken) for order in orders]
        values |= {series(argument, order): symbol for order, symbol in zip(orders, symbols, strict=True)}
        call = _call(series, argument.xreplace(values), orders)
        lines.append(f"[{', '.join(symbol.name for symbol in symbols)}] = {call}")
    return lines, values


def series_operations(values: Mapping[PeriodicFunction, sympy.Symbol]) -> int:
    """Additions and multiplications of the recurrences behind the values, trigonometric calls included."""
    arguments = {(type(each), each.args[0]) for each in values}
    harmonics = [len(series.first) for series, _ in arguments]
    return sum(2 + 6 * count for count in harmonics) + sum(5 * len(each.first) for each in values)


def _inner_first(key: tuple[type[PeriodicFunction], sympy.Expr]) -> tuple:
    series, argument = key
    return nesting(argument, PeriodicFunction), series.__name__, sympy.default_sort_key(argument)


def _call(series: type[PeriodicFunction], argument: sympy.Expr, orders: Sequence[int]) -> str:
    first, second = (f"({', '.join(map(str, family))},)" for family in (series.first, series.second))
    coefficients = f"*_components(\n        {first},\n        {second},\n    )"
    if series.form == "cosine-sine":
        coefficients = f"{first},\n    {second}"
    shifted = [order - 1 if series.integrated else order for order in orders]
    angle = CasadiPrinter().doprint(argument)
    return f"_fourier(\n    {angle}, {series.mean or 0.0},\n    {coefficients},\n    {shifted},\n)"
