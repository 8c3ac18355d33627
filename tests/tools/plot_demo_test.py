#!/usr/bin/env python3
"""tools/plot_demo.py on made-up samples: every picture is drawn, and bad input is told in one line.
Knows the columns of the samples, not the demo."""
import json
import math
import pathlib
import subprocess
import tempfile
import unittest

PLOT = pathlib.Path(__file__).resolve().parent.parent.parent / "tools" / "plot_demo.py"
PICTURES = {"tip_path", "tip_axes", "bending", "displacements", "tensions", "friction_loss"}


def plot(*folders):
    return subprocess.run(["/usr/bin/python3", "-B", str(PLOT), *map(str, folders)], capture_output=True, text=True,
                          timeout=100)


def write_run(folder, sections, tendons, gaps=False):
    """A tip on a circle, and tensions with friction that changes sign; `gaps`: no estimate in the first samples."""
    names = ["t_s", "mode"] + [f"tip_{w}_{a}_m" for w in ("target", "true", "estimate") for a in "xyz"]
    suffixes = [""] if sections == 1 else [f"_{k}" for k in range(1, sections + 1)]
    names += [f"{a}s_{w}_rad{s}" for s in suffixes for w in ("desired", "true", "estimate") for a in "uv"]
    names += [f"{w}_{j}" for j in range(1, tendons + 1) for w in (
        "displacement_desired_m", "displacement_m", "displacement_true_m", "tension_desired_base_N",
        "tension_desired_motor_N", "tension_motor_true_N", "tension_base_true_N", "tension_measured_N",
        "torque_target_Nm", "torque_actual_Nm")]
    lines = [",".join(names)]
    for i in range(300):
        t = i / 50
        angle = max(0.0, t - 1)
        row = [t, 4]
        for error in (0, 5e-4, 3e-4):
            tip = [(0.02 + error) * math.cos(angle), (0.02 + error) * math.sin(angle), 0.05 - error]
            row += ["", "", ""] if gaps and error == 3e-4 and i < 20 else tip
        for k in range(sections):
            row += [(1 + e) * f(angle + k) for e in (0, 0.01, 0.02) for f in (math.cos, math.sin)]
        for j in range(tendons):
            base = 2 + math.sin(angle + 2 * math.pi * j / tendons)
            loss = 0.4 * base * (1 if math.cos(angle + 2 * math.pi * j / tendons) > 0 else -1)
            row += [1e-3 * base, 1.1e-3 * base, 1.02e-3 * base, base, base + loss, base + loss, base, base + loss, 1e-3, 1e-3]
        lines.append(",".join(str(x) for x in row))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "samples.csv").write_text("\n".join(lines) + "\n")
    (folder / "summary.json").write_text(json.dumps({"trajectory": "circle", "compensation": True, "tip_rms_error_m": 7e-4}))


class PlotDemo(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.temporary.name)

    def tearDown(self):
        self.temporary.cleanup()

    def test_pictures_of_one_and_of_two_sections(self):
        one, two = self.folder / "one", self.folder / "two"
        write_run(one, 1, 3, gaps=True)
        write_run(two, 2, 6)
        done = plot(one, two)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for folder in (one, two):
            self.assertEqual({p.stem for p in folder.glob("*.png")}, PICTURES)
            for picture in folder.glob("*.png"):
                self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
                self.assertGreater(picture.stat().st_size, 10000)

    def test_bad_input_is_one_line_that_names_the_file(self):
        write_run(self.folder / "good", 1, 3)
        text = (self.folder / "good" / "samples.csv").read_text()
        summary = (self.folder / "good" / "summary.json").read_text()
        lines = text.split("\n")
        for name, samples, summary_text, says in (
                ("torn", text[: len(text) // 2], summary, "samples.csv:1"),
                ("words", "\n".join([lines[0], lines[1].replace("4", "four", 1), *lines[2:]]), summary, "samples.csv:2"),
                ("empty", "", summary, "samples.csv"),
                ("column", text.replace("tension_base_true_N_2", "tension_b"), summary, "tension_base_true_N_2"),
                ("json", text, "{", "summary.json")):
            with self.subTest(name):
                folder = self.folder / name
                folder.mkdir()
                (folder / "samples.csv").write_text(samples)
                (folder / "summary.json").write_text(summary_text)
                done = plot(folder)
                self.assertEqual(done.returncode, 1, done.stderr)
                self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
                self.assertIn(says, done.stderr)
        done = plot(self.folder / "nowhere")
        self.assertEqual(done.returncode, 1)
        self.assertIn("nowhere", done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
