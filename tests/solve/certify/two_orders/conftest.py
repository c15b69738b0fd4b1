"""Tests of this folder choose the estimate by two orders."""

import pytest

from solve.single import CERTIFICATE, TWO_ORDERS


@pytest.fixture(autouse=True)
def _by_two_orders(monkeypatch):
    monkeypatch.setenv(CERTIFICATE, TWO_ORDERS)
