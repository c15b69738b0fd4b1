"""Proofs of random systems contain the results of an independent integration with 28 digits."""

import dataclasses

import mpmath
import numpy as np
import pytest

pytest.importorskip("flint")

from tests.solve.proof.fixed_point import BITS, monodromy, trigonometric
from tests.solve.proof.population import bump, contradictions, smooth


def test_reference_integration_matches_closed_forms():
    one, zero = np.eye(1), np.zeros((1, 1))
    with mpmath.workprec(BITS):
        nodes = [mpmath.mpf(k) / 8 for k in range(9)]
        parts = (trigonometric([(0, size * one, zero)]) for size in (1.0, 0.5, 2.0))
        Phi = monodromy(*parts, nodes)
        exact = mpmath.expm(mpmath.matrix([[0, 1], [-2, mpmath.mpf(-0.5)]]))
        assert mpmath.norm(Phi - exact) < mpmath.mpf(10) ** -30


@pytest.mark.parametrize("number", range(3))
def test_proofs_contain_the_reference(number):
    case = smooth(number)
    proof = case.proof()
    assert proof.proved
    assert contradictions(case, proof) == []


def test_shifted_disc_is_reported_as_a_contradiction():
    case = smooth(0)
    proof = case.proof()
    moved = dataclasses.replace(proof, multipliers=proof.multipliers + 1e-15)
    assert any("is in no disc" in text for text in contradictions(case, moved))
    unstable = dataclasses.replace(proof, verdict="unstable")
    assert contradictions(case, unstable) == ["instability is proved of a stable system"]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(2))
def test_proofs_with_a_bump_contain_the_reference(number):
    case = bump(number)
    proof = case.proof()
    assert proof.verdict == "unstable"
    assert contradictions(case, proof) == []


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3, 15))
def test_further_proofs_contain_the_reference(number):
    case = smooth(number)
    assert contradictions(case, case.proof()) == []
