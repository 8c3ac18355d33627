#!/usr/bin/env python3
"""Packs the Python package with the module of this build, installs it into a fresh environment and runs its tests there.

The packages it needs are those of the environment that runs this (python/tests/requirements.txt), so nothing is fetched.
Arguments after -- go to pytest.
"""

import argparse
import pathlib
import shutil
import subprocess
import sys
import sysconfig


def run(*command, **options):
    done = subprocess.run([str(word) for word in command], **options)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: exit {done.returncode}")


def fresh_environment(folder):
    """An empty environment whose only packages from elsewhere are the pinned ones that tests need."""
    shutil.rmtree(folder, ignore_errors=True)
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    site = next((folder / "lib").glob("python3*")) / "site-packages"
    (site / "pinned.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin" / "python"


def install(python, source, module, work):
    wheels = work / "wheels"
    shutil.rmtree(wheels, ignore_errors=True)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    run(*pip, "wheel", "--no-build-isolation", "--no-deps", "--no-index", "--wheel-dir", wheels,
        "--config-settings", f"cmake.define.TENDRIL_MODULE={module}", source)
    run(*pip, "--python", python, "install", "--no-deps", "--no-index", "--force-reinstall", *wheels.glob("*.whl"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for option in ("source", "module", "tendril", "work"):
        parser.add_argument(f"--{option}", type=lambda path: pathlib.Path(path).resolve(), required=True)
    parser.add_argument("pytest", nargs="*")
    a = parser.parse_args()
    python = fresh_environment(a.work / "fresh")
    install(python, a.source, a.module, a.work)
    # Not from the source folder, whose package has no module.
    run(python, "-P", "-B", "-m", "pytest", "-q", "--rootdir", a.source, a.source / "tests", *a.pytest, cwd=a.work,
        env={"PATH": f"{a.tendril.parent}:/usr/bin:/bin", "HOME": str(a.work), "LANG": "C.UTF-8",
             "TENDRIL_SOURCE": str(a.source.parent), "MPLCONFIGDIR": str(a.work),
             # What mypy found in files that are the same as before is not looked for again.
             "MYPY_CACHE_DIR": str(a.work / "mypy")})


if __name__ == "__main__":
    main()
