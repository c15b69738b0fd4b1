"""Numbers of the figures, tables and equations of the three sources, transcribed from their captions, and the
sections whose claims are tested. Letters of figure parts are joined: "3.11.abc"."""


def run(*ends: tuple[int, int], before: str = "") -> list[str]:
    return [f"{before}{k}" for first, last in ends for k in range(first, last + 1)]


def parts(number: str, letters: str) -> list[str]:
    return [f"{number}.{letter}" for letter in letters]


FIGURES = {
    "paper": run((1, 3)),
    "chapter": run((1, 20)),
    "thesis": [
        *run((1, 10), before="3."), *parts("3.11", "abc"),
        *run((1, 5), before="4."), *parts("4.6", "abcd"), "4.7",
        *run((1, 2), before="5."), *parts("5.3", "abcd"),
        *run((1, 2), before="6."), *parts("6.3", "ab"), *parts("6.4", "ab"), *run((5, 6), before="6."),
        *run((1, 13), before="7."),
        "8.1", *parts("8.2", "ab"), *run((3, 26), before="8."),
        "9.1", "A.1", "A.2",
        *(part for k in range(1, 25) for part in parts(f"C.{k}", "abc")),
        *(part for k in range(1, 27) for part in parts(f"D.{k}", "abc")),
        *run((1, 3), before="E."),
    ],
}  # fmt: skip
TABLES = {
    "paper": run((1, 2)),
    "chapter": run((1, 5)),
    "thesis": ["3.1", "3.2", "4.1", "5.1.a", "5.1.b", "6.1", "6.2", "6.3", "8.1"],
}
EQUATIONS = {
    "paper": run((1, 37)),
    "chapter": run((1, 78)),
    "thesis": [
        "2.1", *run((1, 13), before="3."), *run((1, 41), before="4."), *run((1, 21), before="5."),
        *run((1, 29), before="6."), *run((1, 11), before="7."), *run((1, 8), before="A."),
        *run((1, 17), before="B."),
    ],
}  # fmt: skip
"""The scan has lost the numbers (4.17), (4.24), (4.39), (4.41), (5.19) and (B.12); those beside them are
there. Below (2.1) it has a stray "(0.1)"."""
CLAIMS = {
    "paper": ["1", "2", "3", "4"],
    "chapter": ["2", "3.1", "3.2", "4.1", "4.2", "4.3", "5"],
    "thesis": [
        "2", "2.2.1", "2.2.2", "3.2", "3.3", "3.4", "3.5", "3.6", "3.7", "3.8", "4.1", "4.2",
        "4.2.3", "4.2.6", "4.3", "4.4", "5.2", "5.2.1", "5.3", "5.4.1", "5.4.2", "5.5", "6.2",
        "6.2.3", "6.3", "6.4", "6.5", "6.6", "6.7", "6.8", "6.9", "7.1", "7.2", "7.2.1", "7.2.3",
        "7.3", "7.4", "7.4.1", "7.4.2", "7.5", "7.6", "8.2", "8.3", "8.4", "8.5", "8.5.1", "8.5.2",
        "9.1", "9.2",
    ],
}  # fmt: skip
