#!/usr/bin/env python3
"""Packs the Python package with the module of this build, installs it into a fresh environment and runs its tests there.

The packages it needs are those of the environment that runs this (python/tests/requirements.txt), so nothing is fetched.
The tests run in groups side by side, since many of them wait. Arguments after -- go to one pytest of all tests instead.
"""

import argparse
import concurrent.futures
import pathlib
import shutil
import subprocess
import sys
import sysconfig

# The first group waits for robots that are simulated in real time, and computes little meanwhile. Robots of two groups have the
# same channels, so each group has a network of its own. Whatever is in none of them is a group as well.
GROUPS = (
    (
        "test_view_live.py",
        "test_client.py",
        "test_dashboard.py",
        "test_dashboard_commands.py",
        "test_dashboard_terminal.py",
    ),
)
OWN_NETWORK = pathlib.Path(__file__).resolve().parents[1] / "tools" / "own_network.sh"


def run(*command, **options):
    done = subprocess.run([str(word) for word in command], check=False, **options)
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


def all_groups(tests):
    """Every file of tests, in exactly one group."""
    named = [tests / name for group in GROUPS for name in group]
    rest = sorted(set(tests.glob("test_*.py")) - set(named))
    return [*([tests / name for name in group] for group in GROUPS), rest]


def run_side_by_side(pytest, groups, **options):
    """Prints what each group says when it has ended; ends with an error where one failed."""

    def tested(files):
        words = [str(word) for word in (OWN_NETWORK, *pytest, *files)]
        return subprocess.run(words, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **options)

    failed = []
    with concurrent.futures.ThreadPoolExecutor(len(groups)) as threads:
        running = {threads.submit(tested, files): " ".join(file.name for file in files) for files in groups}
        for ended in concurrent.futures.as_completed(running):
            names, done = running[ended], ended.result()
            print(f"{names}:", flush=True)
            sys.stdout.buffer.write(done.stdout)
            if done.returncode != 0:
                failed.append(f"{names}: exit {done.returncode}")
    if failed:
        sys.exit("\n".join(failed))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for option in ("source", "module", "tendril", "work"):
        parser.add_argument(f"--{option}", type=lambda path: pathlib.Path(path).resolve(), required=True)
    parser.add_argument("pytest", nargs="*")
    a = parser.parse_args()
    python = fresh_environment(a.work / "fresh")
    install(python, a.source, a.module, a.work)
    # Not from the source folder, whose package has no module.
    options = {"cwd": a.work, "env": {
        "PATH": f"{a.tendril.parent}:/usr/bin:/bin:/usr/sbin:/sbin", "HOME": str(a.work), "LANG": "C.UTF-8",
        "TENDRIL_SOURCE": str(a.source.parent), "MPLCONFIGDIR": str(a.work),
        # What mypy found in files that are the same as before is not looked for again.
        "MYPY_CACHE_DIR": str(a.work / "mypy")}}
    pytest = [python, "-P", "-B", "-m", "pytest", "-q", "--rootdir", a.source]
    if a.pytest:
        run(*pytest, a.source / "tests", *a.pytest, **options)
    else:
        run_side_by_side([*pytest, "--durations=10"], all_groups(a.source / "tests"), **options)


if __name__ == "__main__":
    main()
