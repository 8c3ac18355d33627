"""Compiles the foreign plants into the cache that NUMBA_CACHE_DIR names: once for all that simulate with them."""
import tests.blind.packages  # noqa: F401  (first)
import numpy as np
import yaml

from tests.blind import make, programs

robot = yaml.safe_load((make.ROOT / "config" / "robots" / "rig_90mm.yaml").read_text())
targets = programs.program("weak", programs.Controller(robot), np.random.default_rng(1))[:20]
for plant in ("lagrange", "mujoco"):
    make.outputs(robot, make.planted(robot, [], 1)[0], {}, targets, "motor_side", plant=plant)
