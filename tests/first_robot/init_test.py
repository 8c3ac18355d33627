"""tendril init as a user meets it: options, a terminal, no terminal, files that exist; and what the files are good for.

Usage: init_test.py TENDRIL
"""

import os
import pty
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

TENDRIL = sys.argv[1]
os.chdir(tempfile.mkdtemp())


def run(*words, status=0):
    done = subprocess.run([TENDRIL, *words], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert done.returncode == status, f"{words}: exit {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout if status == 0 else done.stderr


def at_terminal(answers, *words):
    """Types the next answer at each prompt; returns what was shown and the exit status."""
    shown, left = b"", list(answers)

    def read(terminal):
        nonlocal shown
        data = os.read(terminal, 4096)
        shown += data
        if data.rstrip(b" ").endswith(b"]:"):
            os.write(terminal, (left.pop(0) if left else "").encode() + b"\n")
        return data

    status = os.waitstatus_to_exitcode(pty.spawn([TENDRIL, *words], read))
    return shown.decode(), status


def without_terminal():
    refused = run("init", status=2)
    assert refused.count("\n") == 1 and "no terminal" in refused and "--defaults" in refused, refused
    assert not os.listdir("."), os.listdir(".")
    refused = run("init", "--length", "60", status=2)
    assert refused.startswith("tendril: --length: 60 is out of range; accepted: 0.0001 .. 1 m"), refused
    assert not os.listdir("."), os.listdir(".")


def options():
    out = run("init", "--name", "arm", "--tendons", "4", "--length", "90 mm", "--tracker", "none")
    assert "wrote ./arm.yaml and ./arm_tendrild.yaml" in out, out
    text = open("arm.yaml", encoding="utf-8").read()
    assert text.startswith("# "), text
    if text.startswith("# yaml-language-server"):
        schema = text.splitlines()[0].split("$schema=")[1]
        assert os.path.isfile(schema), schema
    assert "unit_length_m: 0.0225" in text and "tracker:" not in text, text
    exists = run("init", "--name", "arm", "--defaults", status=1)
    assert "arm.yaml exists" in exists and "--force" in exists, exists
    assert open("arm.yaml", encoding="utf-8").read() == text
    run("init", "--name", "arm", "--defaults", "--force")
    for folder in ("arm.yaml", "/dev/null/x", 300 * "d"):
        refused = run("init", folder, "--defaults", status=1)
        assert refused.startswith(f"tendril: cannot write into {folder} ("), refused
        assert refused.count("\n") == 1 and refused.endswith("): name another folder\n"), refused
    assert open("arm.yaml", encoding="utf-8").read() != text


def uncertainty():
    """An answer says how well it is known; the file has it, and config check lists it."""
    run("init", "--name", "unsure", "--length", "60 mm within 1 %", "--material", "nitinol within 10 %")
    text = open("unsure.yaml", encoding="utf-8").read()
    assert "youngs_modulus_Pa: {value: 23000000000, within: 10 %}" in text, text
    assert "# Any number may say how well it is known" in text, text
    checked = run("config", "check", "unsure.yaml")
    assert "# uncertainty: the file says of 2 numbers how well they are known" in checked, checked
    assert "#   body.sections[1].youngs_modulus_Pa: 10 %\n" in checked, checked
    assert "# uncertainty" not in run("config", "check", "arm.yaml")
    refused = run("init", "--name", "x", "--length", "60 mm within ten", status=2)
    assert refused.startswith("tendril: --length: within: 'ten' is not understood; accepted: "), refused
    open("again.yaml", "w", encoding="utf-8").write(checked)
    assert run("config", "check", "again.yaml") == checked


def terminal():
    shown, status = at_terminal(["arm2", "hanging", "", "9999", "3", "60", "60 mm"], "init", "new/folder")
    assert status == 0, shown
    assert "9999 is out of range; accepted: whole number 1 .. 16" in shown, shown
    assert "60 looks like millimetres: write 0.06" in shown, shown
    assert "gravity_W_mps2: [0, 0, 9.81]" in open("new/folder/arm2.yaml", encoding="utf-8").read()


def drawing():
    for file in ("arm.yaml", "arm_tendrild.yaml"):
        out = run("config", "check", file, "--draw", "arm.svg")
        for figure in ("bending stiffness", "full bend", "sag under gravity", "natural frequencies", "weight"):
            assert f"#   {figure}" in out, out
        root = xml.etree.ElementTree.parse("arm.svg").getroot()
        assert root.tag.endswith("}svg") and len(root) > 5
        os.remove("arm.svg")
    text = open("arm.yaml", encoding="utf-8").read()
    refused = run("config", "check", "arm.yaml", "--draw", "arm.yaml", status=2)
    assert refused.count("\n") == 1 and "a name that ends in .svg" in refused, refused
    assert open("arm.yaml", encoding="utf-8").read() == text
    refused = run("config", "check", "arm.yaml", "--draw", "no/folder/arm.svg", status=1)
    assert refused.count("\n") == 1 and "no/folder/arm.svg" in refused, refused


def works_at_once():
    out = run("demo", "--robot", "arm.yaml", "--trajectory", "planar", "--no-plots", "--out", "demo")
    assert "tip error" in out, out
    run("sim", "--robot", "arm.yaml", "--daemon", "arm_tendrild.yaml", "--lcm", "memq://", "--headless",
        "--speed", "10", "--duration", "0.5")


without_terminal()
options()
uncertainty()
terminal()
drawing()
works_at_once()
