# Leaves with 77, which ctest shows as skipped, where the foreign plant's packages are missing. Import it first.
import sys

try:
    import distributed  # noqa: F401
    import mujoco  # noqa: F401
    import numba  # noqa: F401
    import numpy  # noqa: F401
    import scipy  # noqa: F401
    import yaml  # noqa: F401
except ImportError as error:
    print(f"skipped: {error}; install tests/blind/requirements.txt into the Python that the tests use")
    sys.exit(77)
