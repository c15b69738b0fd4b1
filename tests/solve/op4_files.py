"""Write OUTPUT4 files in the formats of the NASTRAN manual: text or binary, dense or sparse."""

from itertools import groupby

import numpy as np

KINDS = {"f": 1, "d": 2, "F": 3, "D": 4}
"""Type of a matrix by the character of its array."""


def strings(column):
    """Return the first row, from 1, and the values of each run of nonzero entries."""
    runs = groupby(enumerate(column, start=1), key=lambda pair: pair[1] != 0)
    return [(pairs[0][0], [value for _, value in pairs]) for used, run in runs if used and (pairs := [*run])]


def reals(values):
    """Return values as real numbers; complex values become alternating real and imaginary parts."""
    return np.ascontiguousarray(values).view(np.asarray(values).real.dtype)


def string_header(words, row, big):
    return [words + 1, row] if big else [(words + 1) * 65536 + row]


def text(matrices, layout="dense", digits=16):
    """Return the text of a file. `layout` is "dense", "sparse" or "bigmat"."""
    width, lines = digits + 7, []
    per_line = 80 // width

    def put(values):
        for k in range(0, len(values), per_line):
            lines.append("".join(f"{value:{width}.{digits}E}" for value in values[k : k + per_line]))

    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        shown = -rows if layout == "bigmat" else rows
        kind, form = KINDS[matrix.dtype.char], 6 if rows == columns else 2
        lines.append(f"{columns:8}{shown:8}{form:8}{kind:8}{name:8}1P,{per_line}E{width}.{digits}")
        per_number = 2 - kind % 2
        for number, column in enumerate(matrix.T, start=1):
            runs = strings(column)
            if not runs:
                continue
            if layout == "dense":
                first = runs[0][0]
                values = reals(column[first - 1 : runs[-1][0] - 1 + len(runs[-1][1])])
                lines.append(f"{number:8}{first:8}{len(values):8}")
                put(values)
                continue
            heads = [string_header(per_number * len(reals(v)), row, layout == "bigmat") for row, v in runs]
            words = sum(
                len(head) + per_number * len(reals(v)) for head, (_, v) in zip(heads, runs, strict=True)
            )
            lines.append(f"{number:8}{0:8}{words:8}")
            for head, (_, values) in zip(heads, runs, strict=True):
                lines.append("".join(f"{integer:8}" for integer in head))
                put(reals(values))
        lines.append(f"{columns + 1:8}{1:8}{1:8}")
        put([1.0])
    return "\n".join([*lines, ""])


def binary(matrices, layout="dense", order="<", size=4):
    """Return the bytes of a file. `order` is the byte order, and `size` the number of bytes of an integer, 4
    or 8."""
    made = []

    def record(*parts):
        content = b"".join(parts)
        length = np.array([len(content)], f"{order}i4").tobytes()
        made.append(length + content + length)

    def integers(*values):
        return np.array(values, f"{order}i{size}").tobytes()

    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        kind = KINDS[matrix.dtype.char]
        real = f"{order}f{size if kind in (1, 3) else 8}"
        per_number = np.dtype(real).itemsize // size
        header = integers(columns, -rows if layout == "bigmat" else rows, 6 if rows == columns else 2, kind)
        record(header, name.ljust(2 * size).encode())
        for number, column in enumerate(matrix.T, start=1):
            runs = strings(column)
            if not runs:
                continue
            if layout == "dense":
                first = runs[0][0]
                values = reals(column[first - 1 : runs[-1][0] - 1 + len(runs[-1][1])])
                record(integers(number, first, per_number * len(values)), values.astype(real).tobytes())
                continue
            parts = []
            for row, values in runs:
                words = per_number * len(reals(values))
                parts.append(integers(*string_header(words, row, layout == "bigmat")))
                parts.append(reals(values).astype(real).tobytes())
            record(integers(number, 0, sum(map(len, parts)) // size), *parts)
        record(integers(columns + 1, 1, 1), np.ones(1, real).tobytes())
    return b"".join(made)
