"""The foreign simulators against closed forms and against each other, and what is drawn: the same seed gives the same
files. Leaves with 77, which ctest shows as skipped, where their packages are missing."""

import contextlib
import importlib.util
import io
import json
import math
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

try:
    import cryptography  # noqa: F401
    import mujoco  # noqa: F401
    import numpy as np
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq
    import yaml  # noqa: F401
except ImportError as error:
    print(f"skipped: {error}; install tests/foreign/requirements.txt into the Python that the tests use")
    sys.exit(77)

from tests.blind import seal
from tests.foreign import campaign, draw, mujoco_cable, table, tendons
from tests.foreign.mujoco_cable import Cable

ELASTICA = importlib.util.find_spec("elastica") is not None
PLANTS = ["cable"] + ["elastica"] * ELASTICA
LENGTH, RADIUS, E = 0.2, 0.004, 1e7
EI = E * math.pi * RADIUS**4 / 4


def plain(gravity=(0, 0, 0), home=-1.0, disks=4, payload=0.0, stiffness=500.0, lever=0.015):
    """One section of a straight rod with almost no weight of its own; tendons hang loose unless `home` says
    otherwise."""
    return dict(
        mount="horizontal",
        tendons="4",
        rod_radius_m=RADIUS,
        density_kgpm3=1.0,
        disk_mass_kg=1e-6,
        spool_radius_m=0.01,
        tip_payload_kg=payload,
        gravity_mps2=list(gravity),
        tendon_stiffness_Npm=stiffness,
        home_m=[home] * 4,
        tautness=4.0,
        sections=[
            dict(length_m=LENGTH, disks=disks, youngs_modulus_Pa=E, holes=[(j * math.pi / 2, lever) for j in range(4)])
        ],
    )


def postures(plant, robot, angles):
    return importlib.import_module(campaign.MODULES[plant]).postures(robot, np.atleast_2d(angles))


def elastica_tip(weight):
    """Tip of an inextensible cantilever along z under a weight across it, EI theta'' = -weight cos(theta): (down,
    along) [m]."""

    def shot(curvature):
        return solve_ivp(
            lambda s, y: (y[1], -weight * math.cos(y[0]) / EI, math.sin(y[0]), math.cos(y[0])),
            (0, LENGTH),
            (0, curvature, 0, 0),
            rtol=1e-9,
            atol=1e-12,
        ).y[:, -1]

    end = shot(brentq(lambda c: shot(c)[1], 0, 2 * weight * LENGTH / EI))
    return end[2], end[3]


class ClosedForms(unittest.TestCase):
    def test_cantilever_under_a_weight_is_the_elastica(self):
        for plant in PLANTS:
            for size in (0.2, 1.5):  # weight length^2 / EI
                weight = size * EI / LENGTH**2
                robot = plain(gravity=(0, -9.81, 0), payload=weight / 9.81)
                x, y, z = postures(plant, robot, [0, 0, 0, 0])[0, -1]
                down, along = elastica_tip(weight)
                with self.subTest(plant=plant, size=size):
                    self.assertAlmostEqual(x, 0, delta=1e-5)
                    self.assertAlmostEqual(-y, down, delta=0.01 * down)
                    self.assertAlmostEqual(z, along, delta=0.01 * down)

    def test_one_tendon_bends_a_weightless_rod_into_an_arc(self):
        lever, stiffness, pull = 0.015, 500.0, 0.012
        # moment T lever = EI bend / L, and T = k (pull - lever bend): many disks, so that the tendon follows the arc
        bend = pull * lever * stiffness / (EI / LENGTH + lever**2 * stiffness)
        for plant in PLANTS:
            robot = plain(home=-0.1, disks=10, stiffness=stiffness, lever=lever)
            x, y, z = postures(plant, robot, [(pull + 0.1) / 0.01, 0, 0, 0])[0, -1]
            with self.subTest(plant=plant):
                self.assertAlmostEqual(y, 0, delta=1e-5)
                self.assertAlmostEqual(x, LENGTH * (1 - math.cos(bend)) / bend, delta=0.02 * x)
                self.assertAlmostEqual(math.atan2(x, z), bend / 2, delta=0.02 * bend)

    def test_a_loose_tendon_does_nothing(self):
        robot = plain(gravity=(0, -9.81, 0), payload=0.02)
        for plant in PLANTS:
            loose, looser = postures(plant, robot, [[0, 0, 0, 0], [-3, -3, -3, -3]])
            self.assertLess(np.abs(loose - looser).max(), 1e-6)


class Agreement(unittest.TestCase):
    def test_lengths_and_tensions_are_mujocos(self):
        rng = np.random.default_rng(3)
        robot = draw.robot(rng)
        cable = Cable(robot)
        angles = draw.postures(robot, rng, 3)
        cable.postures(angles)
        p, R = cable.data.xpos[cable.disks], cable.data.xmat[cable.disks].reshape(-1, 3, 3)
        lengths = [tendons.length(w) for w in tendons.ways(robot, p, R)]
        np.testing.assert_allclose(lengths, cable.data.ten_length, atol=1e-12)
        force, moment = tendons.wrenches(robot, p, R, draw.pulls(robot, angles)[-1])
        applied = np.zeros(cable.model.nv)
        for body, f, m in zip(cable.disks, force, moment):
            mujoco.mj_applyFT(cable.model, cable.data, f, m, cable.data.xpos[body], body, applied)
        cable.model.tendon_stiffness[:] = 0
        mujoco.mj_forward(cable.model, cable.data)
        np.testing.assert_allclose(applied + cable.data.qfrc_smooth, 0, atol=1e-6)

    def test_finer_pieces_move_the_cable_by_little(self):
        for seed in (8, 1):  # one section and two
            rng = np.random.default_rng(seed)
            robot = draw.robot(rng)
            angles = draw.postures(robot, rng, 4)
            coarse, fine = Cable(robot).postures(angles), Cable(robot, 8).postures(angles)
            with self.subTest(seed=seed):
                self.assertLess(np.abs(coarse - fine).max(), 0.01 * np.ptp(fine[:, -1], 0).max())

    def test_a_slope_that_nothing_mends_ends_the_search(self):
        np.linalg.cholesky(mujoco_cable.positive(np.array([[1.0, 2.0], [2.0, 1.0]])))
        for slope in ([[math.nan, 0], [0, 1]], [[math.inf, 0], [0, 1]], [[0, 1], [1, 0]]):
            with self.assertRaises(ArithmeticError):
                mujoco_cable.positive(np.array(slope, float))


@unittest.skipUnless(ELASTICA, "no package pyelastica; install tests/foreign/requirements.txt")
class Elastica(unittest.TestCase):
    def test_both_plants_take_the_same_postures_before_and_after_each_change(self):
        for seed in (8, 1):  # one section and two
            rng = np.random.default_rng(seed)
            robot = draw.robot(rng)
            angles = draw.postures(robot, rng, 3)
            changes = [draw.change(robot, kind, rng) for kind in draw.CHANGES]
            for what in (None, *changes):
                its = draw.changed(robot, what) if what else robot
                one, other = (postures(plant, its, angles) for plant in draw.PLANTS)
                with self.subTest(seed=seed, change=what):
                    self.assertLess(np.abs(one - other).max(), 0.02 * np.ptp(one[:, -1], 0).max())

    def test_its_tendons_pull_as_those_of_tendons_py(self):
        from tests.foreign.elastica_rod import Rod, pull_tendons

        rng = np.random.default_rng(3)
        robot = draw.robot(rng)
        pull = draw.pulls(robot, draw.postures(robot, rng, 2))[1]
        rod = Rod(robot)
        rod.settle(pull)
        p, Q = rod.seen(), np.moveaxis(rod.rod.director_collection[..., rod.disks], 2, 0).copy()
        holes = np.array([(*hole, 0.0) for hole, _ in tendons.routes(robot)])
        last = np.array([disk for _, disk in tendons.routes(robot)])
        force, moment = np.zeros_like(p), np.zeros_like(p)
        pull_tendons(p, Q, holes, last, robot["tendon_stiffness_Npm"], rod.rest, force, moment)
        expected = tendons.wrenches(robot, p, np.swapaxes(Q, 1, 2), pull)
        self.assertGreater(np.abs(expected[0]).max(), 0.1)
        np.testing.assert_allclose((force, moment), expected, atol=1e-9)

    def test_finer_pieces_and_a_longer_rest_move_it_by_little(self):
        from tests.foreign import elastica_rod

        for seed in (8, 1):  # one section and two
            rng = np.random.default_rng(seed)
            robot = draw.robot(rng)
            angles = draw.postures(robot, rng, 3)
            coarse, fine = elastica_rod.postures(robot, angles), elastica_rod.Rod(robot, 8).postures(angles)
            with self.subTest(seed=seed):
                self.assertLess(np.abs(coarse - fine).max(), 0.01 * np.ptp(fine[:, -1], 0).max())
                with mock.patch.object(elastica_rod, "STILL", 2e-9):
                    self.assertLess(np.abs(elastica_rod.postures(robot, angles) - coarse).max(), 2e-6)

    def test_without_its_package_the_campaign_names_it_and_makes_nothing(self):
        with tempfile.TemporaryDirectory() as scratch:
            Path(scratch, "elastica.py").write_text("raise ModuleNotFoundError(name='elastica')\n")
            out = Path(scratch, "out")
            args = ["--sets", "1", "--seed", "1", "--plant", "elastica", "--tendril", sys.executable, "--out", str(out)]
            run = subprocess.run(
                [sys.executable, "-B", "-m", "tests.foreign.campaign", *args],
                env=dict(os.environ, PYTHONPATH=os.pathsep.join([scratch, str(campaign.ROOT)]), PYTHONSAFEPATH="1"),
                capture_output=True,
                text=True,
            )
            self.assertEqual(run.returncode, 2, run.stderr)
            self.assertRegex(run.stderr, "--plant elastica: .* has no package pyelastica")
            self.assertFalse(out.exists())


class Draw(unittest.TestCase):
    def test_same_seed_gives_the_same_files(self):
        with tempfile.TemporaryDirectory() as scratch:
            digests = []
            for name, seed in (("a", 4), ("b", 4), ("c", 5)):
                folder = Path(scratch, name)
                folder.mkdir()
                campaign.made(folder, np.random.default_rng([seed, 0]), "cable", "slack", (2, 3))
                digests.append(seal.digest(folder))
        self.assertEqual(digests[0], digests[1])
        self.assertNotEqual(digests[0], digests[2])

    def test_a_robot_without_rest_is_drawn_again_a_few_times(self):
        with tempfile.TemporaryDirectory() as scratch:
            data, fails = Path(scratch, "set"), [ArithmeticError("no way down"), dict(truth=None)]
            with mock.patch.object(campaign, "made", side_effect=fails):
                answer = campaign.drawn(data, [4, 0], "cable", "slack", (2, 3))
            self.assertEqual((answer["seed"], answer["drawn_again"]), ([4, 0, 1], 1))
            with mock.patch.object(campaign, "made", side_effect=ArithmeticError("no way down")) as made:
                with self.assertRaisesRegex(RuntimeError, "no way down.* --seed"):
                    campaign.drawn(data, [4, 0], "cable", "slack", (2, 3))
            self.assertEqual((made.call_count, data.exists()), (campaign.DRAWS, False))

    def test_changes_are_drawn_in_equal_numbers(self):
        kinds = draw.kinds_of(30, draw.PLANTS, np.random.default_rng(1))
        self.assertEqual({kinds.count((p, c)) for p in draw.PLANTS for c in draw.CHANGES}, {5})

    def test_an_exact_map_leads_back_to_the_base(self):
        rng = np.random.default_rng(2)
        robot = draw.robot(rng)
        lab = dict(table.laboratory(robot, rng), turn_error_rad=[0, 0, 0], shift_error_m=[0, 0, 0])
        frame = table.column_map(robot, lab)["frame"]
        p = np.array([0.01, -0.02, 0.3])
        seen = table.rotation(lab["turn_rad"]) @ p + lab["shift_m"]
        np.testing.assert_allclose(table.rotation(frame["rotation_rad"]) @ seen + frame["offset_m"], p, atol=1e-9)

    def test_a_change_changes_only_what_it_says(self):
        robot = draw.robot(np.random.default_rng(1))
        slack = draw.changed(robot, dict(effect="slack", where="tendon:2", value=0.003))
        self.assertAlmostEqual(robot["home_m"][1] - slack["home_m"][1], 0.003)
        self.assertEqual(robot["sections"], slack["sections"])
        soft = draw.changed(robot, dict(effect="bending_stiffness", where="all", value=0.7))
        for one, other in zip(draw.rods(robot), draw.rods(soft)):
            self.assertAlmostEqual(other["bending_Nm2"] / one["bending_Nm2"], 0.7)
            self.assertEqual(one["axial_N"], other["axial_N"])


class Judgement(unittest.TestCase):
    def judged(self, verdict, causes, truth, sections=1):
        robot = dict(mount="hanging", tendons="3", sections=[dict(length_m=0.1, disks=2)] * sections)
        answer = dict(
            id="0000",
            plant="cable",
            truth=truth,
            robot=robot,
            moved_m=1e-3,
            laboratory=dict(frame="fit", noise_m=1e-4, disks=[2]),
        )
        causes = [dict(effect=e, where=w, p=p, group=g, parameters={}) for e, w, p, g in causes]
        return campaign.judged(
            answer, dict(started_ns=0, finished_ns=1, report=dict(verdict=verdict, causes=causes, sentence=""))
        )

    def test_first_cause_its_group_or_another_name_of_it(self):
        soft = dict(effect="bending_stiffness", where="all", value=0.7, unit="")
        loose = dict(effect="slack", where="tendon:2", value=0.002, unit="m")
        other, right = ("tip_force", "all", 0.5, 1), ("bending_stiffness", "section:1", 0.45, 1)
        self.assertTrue(self.judged("ambiguous_group", [other, right], soft)["named"])
        self.assertFalse(self.judged("ambiguous_group", [other, right], soft, sections=2)["named"])
        self.assertFalse(
            self.judged("attributed", [("tip_force", "all", 0.9, 0), ("bending_stiffness", "all", 0.1, 0)], soft)[
                "named"
            ]
        )
        self.assertFalse(self.judged("unexplained", [right], soft)["named"])
        self.assertTrue(self.judged("attributed", [("encoder_offset", "tendon:2", 0.9, 0)], loose)["named"])
        wrong = self.judged("attributed", [("slack", "tendon:1", 0.9, 0), ("no_gap", "all", 0.1, 0)], loose)
        self.assertFalse(wrong["named"])
        self.assertEqual((wrong["p"], wrong["wrong_p"]), (0, 0.9))


# A program that answers as tendril does, the same to every set; it is called wrongly while there is a file "broken".
ANSWERS_ALIKE = """#!/bin/sh
[ "$1" = --version ] && echo "tendril 0 alike" && exit
[ -e "$(dirname "$0")/broken" ] && exit 2
[ "$2" = import ] && exit
while [ "$1" != --out ]; do shift; done
echo '{"verdict": "attributed", "sentence": "", "location": [], "causes": [
  {"effect": "slack", "where": "tendon:1", "p": 0.9, "group": 0, "parameters": {"length": {"value": 0.002}}}]}' > \
  "$2/report.json"
"""


class Command(unittest.TestCase):
    def setUp(self):
        self.scratch = Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.scratch.chmod(0o755)  # the diagnosis is another user's
        self.folder, self.vault, self.program = (self.scratch / name for name in ("c", "c.vault", "tendril"))
        self.program.write_text(ANSWERS_ALIKE)
        self.program.chmod(0o755)
        self.enterContext(mock.patch.multiple(campaign, FEWEST=2, MOST=3))

    def run_it(self, out=None, sets=2):
        words = ["--sets", sets, "--seed", 1, "--plant", "cable", "--jobs", 1, "--tendril", self.program]
        words += ["--out", out or self.folder]
        silent = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
        with mock.patch.object(sys, "argv", ["gap_foreign", *map(str, words)]), silent[0], silent[1]:
            return campaign.main()

    def refused(self, why, **how):
        with self.assertRaisesRegex(campaign.Wrong, why):
            self.run_it(**how)

    @contextlib.contextmanager
    def other(self, path, text):
        """A file with other text, for a while."""
        kept, mode = path.read_text(), path.stat().st_mode
        path.chmod(mode | 0o200)
        path.write_text(text if isinstance(text, str) else text(kept))
        yield
        path.write_text(kept)
        path.chmod(mode)

    def test_from_the_draw_to_the_score_in_two_goes(self):
        closed = self.scratch / "closed"
        closed.mkdir(0o700)
        (closed / "truth").touch(0o400)
        try:
            seal.confined(closed, closed)
        except campaign.Wrong as refusal:  # a machine where nothing can be hidden
            self.skipTest(str(refusal))
        (self.scratch / "broken").touch()
        self.refused("exit code 2")
        seals = seal.digest(self.folder / "seals")
        self.assertFalse((self.folder / "summary.json").exists())
        how = dict(folder=str(self.folder), vault=str(self.vault), seed=1, postures=(2, 3))
        truth = (self.vault / "0000.json").read_text()
        campaign.make_one(how, 0, "cable", "slack")  # as after a worker's death
        self.assertEqual((self.vault / "0000.json").read_text(), truth)
        (self.scratch / "broken").unlink()
        self.assertEqual(self.run_it(), 0)
        self.assertEqual(seal.digest(self.folder / "seals"), seals)
        summary = json.loads((self.folder / "summary.json").read_text())
        self.assertEqual(summary["plan"], dict(sets=2, seed=1, plant="cable"))
        self.assertEqual(summary["program"], dict(sha256=seal.sha(ANSWERS_ALIKE.encode()), version="tendril 0 alike"))
        for given in summary["sets"]:
            name = given["id"]
            self.assertEqual(given["given_sha256"], seal.sha((self.folder / "answers" / f"{name}.json").read_bytes()))
            self.assertEqual(given["seal"]["answer_sha256"], seal.sha((self.vault / f"{name}.json").read_bytes()))
            self.assertEqual(given["seal"]["data_sha256"], seal.digest(self.folder / "sets" / name))
        self.damaged()

    def damaged(self):
        """What is changed in a campaign that was scored is refused, and scored again where it is put back."""
        answer, truth = self.folder / "answers" / "0001.json", self.vault / "0001.json"
        data = self.folder / "sets" / "0001" / "after.csv"
        for path, text, why in (
            (answer, lambda kept: kept.replace("0.9", "0.1"), "answers/0001.json: not the answer that was given"),
            (answer, "{", "answers/0001.json: not as gap_foreign wrote it; put it back"),
            (truth, lambda kept: kept + " ", "c.vault/0001.json: not the sealed answer; put it back"),
            (data, "t", "answers/0001.json: the data are not the sealed ones"),
            (self.vault / "plan.json", self.shorter, "--sets 2: this campaign was begun with 1"),
            (self.vault / "plan.json", "[]", "plan.json: not the plan that gap_foreign wrote; put it back"),
            (self.vault / seal.LEDGER, lambda kept: kept.replace("0001", "0002"), "put the ledger back"),
        ):
            with self.other(path, text):
                self.refused(why)
        self.assertEqual(self.run_it(), 0)
        with self.other(self.vault / "plan.json", self.shorter):
            self.refused("set 0001 is not in .*plan.json", sets=1)
        self.refused("--sets 3: this campaign was begun with 2", sets=3)
        kept = answer.rename(self.scratch / "kept.json")
        with self.other(data, "t"), self.assertRaisesRegex(RuntimeError, "1 of 2 sets without an answer: 0001"):
            self.run_it()
        with self.other(self.program, ANSWERS_ALIKE + "# another build"):
            self.refused("another build than the one that answered 0000.json")
        self.run_again_with(kept, answer)

    def shorter(self, plan):
        """The plan without its last set."""
        plan = json.loads(plan)
        return json.dumps(dict(plan, sets=1, kinds=plan["kinds"][:1]))

    def run_again_with(self, kept, answer):
        """A second answer to the same set is no answer; the first one is."""
        self.refused("answers/0001.json: answered 2 times")
        answer.unlink()
        kept.rename(answer)

    def test_another_program_than_the_one_written_down_answers_nothing(self):
        words = ["/bin/sh", "-c", "exit 0"], seal.sha(b"another"), str(self.vault), str(self.folder)
        with self.assertRaisesRegex(seal.NotRun, "tendril is another program"):
            seal.run_sealed(str(self.folder), *words, str(self.scratch / "claim"), 60, str(self.program))

    def test_folders_of_others_are_left_alone(self):
        other = self.scratch / "other"
        other.mkdir()
        (other / "thesis.txt").touch()
        (self.scratch / "file").touch()
        self.refused("--out /: is the root", out="/")
        self.refused("holds thesis.txt, and is no campaign of gap_foreign; name a new or an empty folder", out=other)
        self.refused("file is a file", out=self.scratch / "file")
        blind, vault = self.scratch / "b", self.scratch / "b.vault"
        for d in (blind, blind / "sets", vault):
            d.mkdir()
        (blind / "vault").write_text(f"{vault.resolve()}\n")
        (vault / "1_of_1_of_2.kinds").touch()
        self.refused("b: is a campaign of gap_blind; name", out=blind)
        self.assertEqual({p.name for p in self.scratch.iterdir()}, {"other", "file", "b", "b.vault", "tendril"})
        self.assertEqual([p.name for p in other.iterdir()], ["thesis.txt"])


if __name__ == "__main__":
    if not ELASTICA:
        print("PyElastica's half is skipped: no package pyelastica; install tests/foreign/requirements.txt")
    unittest.main()
