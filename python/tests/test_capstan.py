"""The transmission: the ratio of `tendril capstan` bit for bit."""

from __future__ import annotations

import json
import math

import pytest

import tendril

from conftest import program


@pytest.mark.parametrize("direction", ["pull", "release"])
@pytest.mark.parametrize("law", ["cumulative", "local", "classic"])
def test_equals_the_command_line(direction, law):
    theirs = json.loads(
        program("capstan", "--alpha", 0.2, "--n", 0.8, "--rho", 20, "--wrap", 1.5, "--tension", 2.5, "--phi1", 0.1,
                "--direction", direction, "--law", law, "--low-tension", 0.05)
    )  # fmt: skip
    ours = tendril.capstan(0.2, 1.5, 2.5, n=0.8, rho=20, phi1=0.1, direction=direction, law=law, low_tension=0.05)
    assert list(ours) == [theirs["ratio"], theirs["tension_motor_N"], theirs["tension_base_N"]]


def test_the_classic_law_is_the_classic():
    assert tendril.capstan(0.3, 2.0, 1.0, law="classic").ratio == pytest.approx(math.exp(0.6), rel=1e-12)


def test_wrong_arguments():
    with pytest.raises(ValueError, match="n and rho are required"):
        tendril.capstan(0.2, 1.5, 2.5)
    with pytest.raises(ValueError, match="alpha is nan"):
        tendril.capstan(math.nan, 1.5, 2.5, n=0.8, rho=20)
    with pytest.raises(ValueError, match="direction is 'up'; accepted: pull, release"):
        tendril.capstan(0.2, 1.5, 2.5, n=0.8, rho=20, direction="up")
    with pytest.raises(ValueError, match="alpha"):
        tendril.capstan(-1, 1.5, 2.5, n=0.8, rho=20)
