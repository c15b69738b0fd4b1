"""Accuracy implied by the digits of a printed number."""


def half_a_digit(printed: str) -> float:
    """Return half a unit in the last place of a printed number: for "1.230e-4", 0.5e-7."""
    mantissa, _, exponent = printed.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)
