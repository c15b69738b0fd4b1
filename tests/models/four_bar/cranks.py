"""Linkages for the tests: that of the thesis, and random linkages whose crank can turn fully."""

from hypothesis import strategies as st

from models.four_bar.linkage import BRANCHES, Linkage

THESIS = (0.170, 0.328, 0.525, 0.547)
"""Lengths (m) of Table 3.2."""


@st.composite
def cranks(draw: st.DrawFn) -> Linkage:
    """Linkages with |L1 - L4| > |L2 - L3| and L1 + L4 < L2 + L3, and with margins such that the transmission
    angle differs from 0 and π."""
    L1, L4 = draw(
        st.tuples(st.floats(0.1, 1.0), st.floats(0.1, 1.0)).filter(lambda x: abs(x[0] - x[1]) > 0.05)
    )
    difference = draw(st.floats(-0.9, 0.9)) * abs(L1 - L4)
    total = (L1 + L4) * draw(st.floats(1.05, 4.0))
    branch = draw(st.sampled_from(list(BRANCHES)))
    return Linkage(L1, (total + difference) / 2, (total - difference) / 2, L4, branch)
