#!/usr/bin/env python3
"""tools/plot_demo.py on made-up samples: every picture is drawn, words stand apart from each other and from curves,
nothing is hidden, and bad input gets one line.
Knows the columns of the samples, not the demo."""
import itertools
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

PLOT = pathlib.Path(__file__).resolve().parent.parent.parent / "tools" / "plot_demo.py"
sys.path.insert(0, str(PLOT.parent))
import plot_demo  # noqa: E402

PICTURES = {"tip_path", "tip_axes", "bending", "displacements", "tensions", "friction_loss"}


def plot(*folders):
    return subprocess.run(["/usr/bin/python3", "-B", str(PLOT), *map(str, folders)], capture_output=True, text=True,
                          timeout=300)


def write_run(folder, sections, tendons, gaps=False, size=1.0, planar=False):
    """A tip on a circle (`planar`: on an arc), and tensions with friction that changes sign; `gaps`: no estimate in the
    first samples; `size`: of the robot."""
    names = ["t_s", "mode"] + [f"tip_{w}_{a}_m" for w in ("target", "true", "estimate") for a in "xyz"]
    suffixes = [""] if sections == 1 else [f"_{k}" for k in range(1, sections + 1)]
    names += [f"{a}s_{w}_rad{s}" for s in suffixes for w in ("desired", "true", "estimate") for a in "uv"]
    names += [f"{w}_{j}" for j in range(1, tendons + 1) for w in (
        "displacement_desired_m", "displacement_m", "displacement_true_m", "tension_desired_base_N",
        "tension_desired_motor_N", "tension_motor_true_N", "tension_base_true_N", "tension_measured_N",
        "torque_target_Nm", "torque_actual_Nm")]
    names += [f"disk_{a}_m_{i}" for i in range(1, 5) for a in "xyz"]
    lines = [",".join(names)]
    for i in range(300):
        t = i / 50
        angle = max(0.0, t - 1)
        row = [t, 4]
        for error in (0, 5e-4, 3e-4):
            tip = [size * x for x in ([(0.02 + error) * math.cos(angle), (0.02 + error) * math.sin(angle), 0.05 - error]
                                      if not planar else arc(min(1.6, 0.3 * angle) + error, 0.09))]
            row += ["", "", ""] if gaps and error == 3e-4 and i < 20 else tip
            true = tip if error == 5e-4 else row[5:8]
        for k in range(sections):
            row += [(1 + e) * f(angle + k) for e in (0, 0.01, 0.02) for f in (math.cos, math.sin)]
        for j in range(tendons):
            base = 2 + math.sin(angle + 2 * math.pi * j / tendons)
            loss = 0.4 * base * (1 if math.cos(angle + 2 * math.pi * j / tendons) > 0 else -1)
            row += [1e-3 * base, 1.1e-3 * base, 1.02e-3 * base, base, base + loss, base + loss, base, base + loss, 1e-3, 1e-3]
        # Two arcs of 45 degrees each way round, as near as disks of a made-up robot need be.
        row += [x * (k / 4) ** (2 if a < 2 else 1) for k in range(1, 5) for a, x in enumerate(true)]
        lines.append(",".join(str(x) for x in row))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "samples.csv").write_text("\n".join(lines) + "\n")
    (folder / "summary.json").write_text(json.dumps({"trajectory": "circle", "compensation": True, "tip_rms_error_m": 7e-4}))


def arc(bend, length):
    """The end of an arc in the xz plane that starts along z."""
    return [length * (1 - math.cos(bend)) / bend, 0, length * math.sin(bend) / bend] if bend else [0, 0, length]


def overlap(a, b):
    return min(a.x1, b.x1) > max(a.x0, b.x0) and min(a.y1, b.y1) > max(a.y0, b.y0)


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
            for kind, begin in (("png", b"\x89PNG\r\n\x1a\n"), ("svg", b"<?xml"), ("pdf", b"%PDF-")):
                self.assertEqual({p.stem for p in folder.glob("*." + kind)}, PICTURES)
                for picture in folder.glob("*." + kind):
                    self.assertTrue(picture.read_bytes().startswith(begin), picture)
                    self.assertGreater(picture.stat().st_size, 8000)

    def run_of(self, *arguments, **options):
        folder = self.folder / str(len(list(self.folder.iterdir())))
        write_run(folder, *arguments, **options)
        return plot_demo.Run(folder)

    def drawn(self, picture, run):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        figure = plot_demo.PICTURES[picture](run)
        FigureCanvasAgg(figure).draw()
        return figure

    def test_words_of_the_path_stand_apart_for_robots_of_any_size(self):
        import numpy as np
        from mpl_toolkits.mplot3d import proj3d
        for size, planar in itertools.product((0.5, 30), (False, True)):
            with self.subTest(size=size, planar=planar):
                run = self.run_of(1, 3, size=size, planar=planar)
                figure = self.drawn("tip_path", run)
                a, = figure.axes
                quarters = {t.get_text(): t for t in a.texts}
                self.assertGreaterEqual(set(quarters), {"0", "¼", "½", "¾"})
                # Those that are drawn; asking for all of them would move them.
                ticks = [tick.label1 for axis in (a.xaxis, a.yaxis, a.zaxis) for tick in axis.majorTicks
                         if axis.get_view_interval()[0] < tick.get_loc() < axis.get_view_interval()[1]]
                words = [*ticks, *quarters.values(), *figure.texts]
                boxes = [(w.get_text(), w.get_window_extent()) for w in words if w.get_visible()]
                for (one, its), (other, others) in itertools.combinations(boxes, 2):
                    self.assertFalse(overlap(its, others), f"{one!r} on {other!r}")
                labels = [axis.label for axis in (a.xaxis, a.yaxis, a.zaxis)]
                for text, box in boxes + [(w.get_text(), w.get_window_extent()) for w in labels]:
                    self.assertTrue(figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1 and
                                    figure.bbox.y0 <= box.y0 and box.y1 <= figure.bbox.y1, f"{text!r} is cut")
                for line in a.lines:
                    points = np.array(line.get_data_3d())
                    seen = a.transData.transform(np.array(proj3d.proj_transform(*points, a.get_proj())[:2]).T)
                    for text in quarters.values():
                        box = text.get_window_extent()
                        over = (seen > (box.x0, box.y0)).all(axis=1) & (seen < (box.x1, box.y1)).all(axis=1)
                        self.assertFalse(over.any(), f"{text.get_text()} lies on {line.get_label()}")

    def test_the_robot_is_drawn_at_rest_and_at_its_quarters(self):
        run = self.run_of(1, 3, planar=True)
        a, = self.drawn("tip_path", run).axes
        shapes = [line for line in a.lines if len(line.get_data_3d()[0]) == 1 + 8 * run.disks]
        self.assertEqual(len(shapes), 6)  # at rest, four quarters, and the end, which is not the beginning
        for shape in shapes:
            self.assertEqual([c[0] for c in shape.get_data_3d()], [0, 0, 0])

    def test_the_backbone_is_the_arc_through_the_disks(self):
        import numpy as np
        run = self.run_of(1, 3)
        for bend in (0.0, 0.7, 2.6):
            for i in range(1, 5):
                for a, x in zip("xyz", arc(bend * i / 4, 0.06 * i / 4)):
                    run.columns[f"disk_{a}_m_{i}"][0] = x
            shape = run.backbone(0)
            np.testing.assert_allclose(shape[:, -1], arc(bend, 0.06), atol=1e-12)
            if bend:
                radius = 0.06 / bend
                distance = np.linalg.norm(shape - np.array([[radius], [0], [0]]), axis=0)
                np.testing.assert_allclose(distance, radius, rtol=1e-9)
            steps = np.linalg.norm(np.diff(shape, axis=1), axis=0)
            np.testing.assert_allclose(steps, steps[0], rtol=1e-9)

    def test_no_tendon_lies_under_another(self):
        run = self.run_of(1, 3)
        for name in list(run.columns):
            if name.endswith("_3"):
                run.columns[name] = run.columns[name[:-1] + "2"]
        for picture in ("displacements", "tensions", "friction_loss"):
            panels = self.drawn(picture, run).axes
            for tendon in (1, 2, 3):
                self.assertEqual(sum(f"tendon {tendon}" in a.get_ylabel() for a in panels), 1, picture)

    def test_the_estimate_does_not_hide_the_truth(self):
        run = self.run_of(1, 3)
        for picture in ("tip_axes", "bending", "displacements"):
            for a in self.drawn(picture, run).axes:
                lines = {line.get_color(): line for line in a.lines}
                true, believed = lines.get(plot_demo.TRUE), lines.get(plot_demo.BELIEVED)
                if true and believed:
                    self.assertTrue(believed.get_zorder() < true.get_zorder() or believed.get_linestyle() != "-", picture)

    def test_legends_lie_beside_the_panels(self):
        for run in (self.run_of(1, 3), self.run_of(2, 6)):
            for picture in PICTURES - {"tip_path"}:
                figure = self.drawn(picture, run)
                box, = (g.get_window_extent() for g in figure.legends)
                for a in figure.axes:
                    self.assertFalse(overlap(box, a.get_window_extent()), picture)
                    self.assertIsNone(a.get_legend(), picture)
                self.assertLessEqual(box.x1, figure.bbox.x1, picture)

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
