"""The command line of the view. A browser is not needed here; see test_view_page.py."""

import os
import shutil
import subprocess
import sys

import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")
pytest.importorskip("lcm", reason="the extra 'view' is not installed")


def command(*words):
    return subprocess.run(
        [sys.executable, "-P", "-m", "tendril.view", *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    "words, status, line",
    [
        (["--port", "99999"], 2, "--port"),
        (["--port", "http"], 2, "--port"),
        (["--duration", "nan"], 2, "--duration"),
        (["--robot", "x.yaml"], 2, "--robot is for logs"),
        (["--at", "1"], 2, "--at is a time of a recording"),
        (["nowhere.lcmlog"], 1, "no such file"),
        (["--lcm", "tcp://nowhere"], 1, "LCM address"),
        (["--prefix", "a b"], 2, "1 to 40 letters"),
    ],
)
def test_bad_words_are_one_line(words, status, line):
    done = command(*words)
    assert (done.returncode, done.stdout) == (status, "")
    assert (
        done.stderr.count("\n") == 1 and done.stderr.startswith("tendril: view: ") and line in done.stderr
    ), done.stderr


def test_a_time_after_the_end_is_one_line(circle):
    done = command("--no-browser", "--port", "0", "--at", "100", str(circle))
    assert (done.returncode, done.stdout) == (1, "") and "ends at 4.0 s" in done.stderr


def test_a_full_standard_output_is_one_line(circle):
    words = [sys.executable, "-P", "-m", "tendril.view", "--no-browser", "--port", "0", str(circle)]
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "No space left" in done.stderr, done.stderr


def test_help_names_every_option():
    done = command("--help")
    assert done.returncode == 0
    for word in (
        "SOURCE",
        "--robot",
        "--lcm",
        "--prefix",
        "--port",
        "--no-browser",
        "--duration",
        "127.0.0.1",
    ):
        assert word in done.stdout


@pytest.mark.skipif(not shutil.which("tendril"), reason="the program is not on the path")
def test_tendril_hands_over_to_the_view():
    def handed_over(python, *words):
        environment = {**os.environ, "TENDRIL_PYTHON": python}
        done = subprocess.run(
            ["tendril", "view", *words],
            capture_output=True,
            text=True,
            timeout=60,
            env=environment,
            check=False,
        )
        assert done.stdout == "" and done.stderr.count("\n") == 1, done.stderr
        return done.returncode, done.stderr

    assert handed_over(sys.executable, "--", "-nowhere")[1].startswith(
        "tendril: view: '-nowhere': no such file"
    )
    status, line = handed_over("/usr/bin/false", "nowhere")
    assert status == 1 and "pip install './python[view]'" in line
    assert handed_over(sys.executable, "--port", "99999")[0] == 2
    assert handed_over(sys.executable, "--robot", "x.yaml")[0] == 2
