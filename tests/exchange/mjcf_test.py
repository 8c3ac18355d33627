"""What `tendril model export` writes, in MuJoCo: rest, natural frequencies and friction are those of Tendril's model,
for every robot in config/robots.

Usage: mjcf_test TENDRIL ROBOTS_FOLDER [--print]; --print shows how far both are apart, in more states. Neither
simulator knows the other.
"""

import csv
import io
import itertools
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import warnings

try:
    import mujoco
    import numpy as np
    import yaml
except ImportError as error:
    print(f"skipped: {error}; install tests/blind/requirements.txt into the Python that the tests use")
    sys.exit(77)

TENDRIL, ROBOTS, SHOW = sys.argv[1], pathlib.Path(sys.argv[2]), "--print" in sys.argv
STATES = 40 if SHOW else 8  # of each robot, at least
STATICS, FREQUENCIES = 0.01, 0.02  # of the tip's way; of each of the first three


def tendril(*words, rows=None, status=0):
    text = None
    if rows is not None:
        text = "\n".join(
            [",".join(f"T{j + 1}" for j in range(len(rows[0])))] + [",".join(map(repr, map(float, r))) for r in rows]
        )
    done = subprocess.run([TENDRIL, *map(str, words)], input=text, capture_output=True, text=True)
    assert status is None or done.returncode == status, (words, done.stderr)
    return done


def table(*words, rows):
    """One row of values each; None where the equilibrium does not exist."""
    found = []
    for row in rows:
        done = tendril(*words, rows=[row], status=None)
        lines = list(csv.reader(io.StringIO(done.stdout)))
        found.append(np.array(lines[1], float) if done.returncode == 0 else None)
    return found


def exported(robot, *words):
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "robot.xml"
        done = tendril("model", "export", "--robot", robot, "--mjcf", file, *words)
        return mujoco.MjModel.from_xml_path(str(file)), done.stderr


def units_of(robot):
    return [s["units"] for s in robot["body"]["sections"]]


def grid(robot, seed=1):
    """Tensions between the file's limits: corners with one and two tendons pulled, and others at random."""
    tendons = sum(len(s["tendons"]) for s in robot["body"]["sections"])
    least, most = robot["limits"]["min_tension_N"], robot["limits"]["max_tension_base_N"]
    rows = [np.full(tendons, least)]
    for size in (1, 2):
        for pulled in itertools.combinations(range(tendons), size):
            rows += [
                np.where(np.isin(range(tendons), pulled), least + share * (most - least), least) for share in (0.3, 0.6)
            ]
    rng = np.random.default_rng(seed)
    rows += list(least + rng.random((40, tendons)) ** 2 * (most - least))
    return rows


def within_limits(robot, q):
    at = 0
    for units in units_of(robot):
        if np.linalg.norm(q[2 * at : 2 * (at + units)].reshape(-1, 2).sum(0)) > robot["limits"]["max_bending_rad"]:
            return False
        at += units
    return True


def settle(model, data, slowest_Hz, stiffness_Nm):
    """Steps until it rests, damped so that this is soon, which does not change where. The speed that is left."""
    before = model.dof_damping.copy()
    hinges = np.array([i for i in range(model.njnt) if model.joint(i).name.startswith("unit")])
    model.dof_damping[model.jnt_dofadr[hinges]] = 2 * 1.6 * stiffness_Nm / (2 * np.pi * slowest_Hz)
    for _ in range(int(5 / model.opt.timestep / 100)):
        mujoco.mj_step(model, data, nstep=100)
        if np.abs(data.qvel).max() < 1e-4 * slowest_Hz:
            break
    model.dof_damping[:] = before
    return np.abs(data.qvel).max()


def frequencies(model, data):
    """Of MuJoCo's own steps about where it is, without damping, the slowest three [Hz]."""
    model.dof_damping[:] = 0
    data.qvel[:] = 0
    step = np.zeros((2 * model.nv, 2 * model.nv))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, step, None, None, None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # tied motion dies in one step: its logarithm is not finite
        rates = np.log(np.linalg.eigvals(step).astype(complex)) / model.opt.timestep
    return np.sort(rates.imag[rates.imag > 1])[:3] / 2 / np.pi


def show(*words):
    if SHOW:
        print(*words, flush=True)


def stiffness_Nm(robot):
    section = robot["body"]["sections"][0]
    return (
        float(section["youngs_modulus_Pa"])
        * np.pi
        / 4
        * float(section["core_radius_m"]) ** 4
        / section["unit_length_m"]
    )


def straight_tip(robot):
    return np.array([0, 0, sum(s["units"] * s["unit_length_m"] for s in robot["body"]["sections"])])


class Agreement(unittest.TestCase):
    def rest(self, model, robot, tensions, slowest_Hz):
        data = mujoco.MjData(model)
        data.ctrl[: len(tensions)] = tensions
        self.assertLess(settle(model, data, slowest_Hz, stiffness_Nm(robot)), 1e-4 * slowest_Hz, "not at rest")
        return data

    def compare(self, file, robot, states=STATES):
        rows = grid(robot)
        shapes = table("model", "statics", "--robot", file, rows=rows)
        keep = [i for i, s in enumerate(shapes) if s is not None and within_limits(robot, s[:-3])]
        keep = keep[:: max(1, len(keep) // states)]
        self.assertGreaterEqual(len(keep), 8, "too few states to compare")
        rows, shapes = [rows[i] for i in keep], [shapes[i] for i in keep]
        model, _ = exported(file, "--actuators", "tensions")
        away, apart = [], []
        for tensions, shape, expected in zip(rows, shapes, table("model", "frequencies", "--robot", file, rows=rows)):
            data = self.rest(model, robot, tensions, expected[0])
            way = np.linalg.norm(shape[-3:] - straight_tip(robot))
            if way > 1e-3:
                away.append(np.linalg.norm(data.site("tip").xpos - shape[-3:]) / way)
            apart.append(np.abs(frequencies(model, data) / expected[:3] - 1).max())
        rms = np.sqrt(np.mean(np.square(away)))
        show(
            f"{file.stem}: {len(rows)} states, step {1e3 * model.opt.timestep:g} ms; "
            f"tip {100 * max(away):.2f} % of its way (rms {100 * rms:.2f} %), frequencies {100 * max(apart):.2f} %"
        )
        self.assertLess(max(away), STATICS)
        self.assertLess(max(apart), FREQUENCIES)

    def test_every_robot_of_the_folder(self):
        files = sorted(ROBOTS.glob("*.yaml"))
        self.assertGreater(len(files), 4)
        for file in files:
            robot = yaml.safe_load(file.read_text())
            with self.subTest(robot=file.stem):
                if any("strains" in section for section in robot["body"]["sections"]):
                    refused = tendril("model", "export", "--robot", file, "--mjcf", "unused.xml", status=1)
                    self.assertIn("tendril model export knows bending alone", refused.stderr)
                else:
                    self.compare(file, robot)

    def test_what_an_ideal_robot_does_not_have(self):
        more = (
            "  tip_payload_kg: 0.003\n  tip_force_W_N: [0.02, -0.01, 0.01]\n  twist_rad_per_m: 4.0\n"
            "  unit_deviations:\n    - {unit: 2, stiffness_scale: 1.3, rest_u_rad: 0.1, rest_v_rad: -0.05}\n"
        )
        text = (ROBOTS / "rig_60mm.yaml").read_text()
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "bent.yaml"
            file.write_text(text.replace("body:\n", "body:\n" + more, 1))
            self.compare(file, yaml.safe_load(text), states=8)


class Motors(unittest.TestCase):
    """The rig with its motors: what they hold, and what friction takes on the way."""

    ROBOT = ROBOTS / "rig_60mm.yaml"

    def setUp(self):
        self.robot = yaml.safe_load(self.ROBOT.read_text())
        actuation = self.robot["actuation"]
        self.newton_per_Nm = actuation["gear"]["ratio"] / actuation["spool"]["radius_m"]
        self.model, self.left_out = exported(self.ROBOT, "--friction-at", 2)

    def friction(self, tendon):
        return self.model.tendon_frictionloss[self.model.tendon(tendon).id]

    def hold(self, tensions_N):
        """After the motors' torques rose slowly to those that hold these tensions without friction."""
        data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, data, 0)
        begin, end = data.ctrl.copy(), np.array(tensions_N) / self.newton_per_Nm
        steps = int(2 / self.model.opt.timestep)
        for i in range(steps):
            data.ctrl[:] = begin + min(1, 2 * i / steps) * (end - begin)
            mujoco.mj_step(self.model, data)
        return data

    def expected(self, tensions_N):
        return table("model", "statics", "--robot", self.ROBOT, rows=[tensions_N])[0][-3:]

    def assert_near(self, tip, expected, share):
        way = np.linalg.norm(expected - straight_tip(self.robot))
        show(f"motors: tip {100 * np.linalg.norm(tip - expected) / way:.2f} % of its way")
        self.assertLess(np.linalg.norm(tip - expected) / way, share)

    def test_torques_hold_tensions(self):
        self.model.tendon_frictionloss[:] = 0
        self.model.dof_frictionloss[:] = 0
        self.model.dof_damping[:3] = 100  # of the spools, which swing for long without friction
        tensions = [4, 1, 0.5]
        self.assert_near(self.hold(tensions).site("tip").xpos, self.expected(tensions), STATICS)

    def test_friction_takes_from_who_pulls_and_adds_to_who_pays_out(self):
        torques_N = np.array([6, 0.3, 0.3])
        data = self.hold(torques_N)
        tendons = [self.model.tendon(f"tendon{j}").id for j in (1, 2, 3)]
        stretch = data.ten_length[tendons] - self.model.tendon_lengthspring[tendons, 1]
        between = self.model.tendon_stiffness[tendons] * stretch  # motor and pulley
        spool = self.model.dof_frictionloss[self.model.joint("spool1").dofadr[0]]
        np.testing.assert_allclose(between - torques_N, [-spool, spool, spool], rtol=0.01)
        lost = data.efc_force[data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON]
        self.assertAlmostEqual(lost[0], self.friction("tendon1_path"), places=6)
        self.assertTrue((lost[1:] < -0.5 * self.friction("tendon2_path")).all(), lost)
        tip = data.site("tip").xpos
        self.assert_near(tip, self.expected(between - lost), STATICS)
        self.assertGreater(np.linalg.norm(tip - self.expected(between)), 5e-3)

    def test_friction_is_as_wide_as_that_of_the_pulley(self):
        pulley = self.robot["actuation"]["transmission"]["pulleys"][0]
        words = [
            "capstan",
            "--alpha",
            pulley["alpha"],
            "--n",
            pulley["exponent"],
            "--rho",
            pulley["radius_ratio"],
            "--wrap",
            pulley["wrap_rad"],
            "--tension",
            2,
        ]
        pull, release = (
            json.loads(tendril(*words, "--direction", d).stdout)["tension_motor_N"] for d in ("pull", "release")
        )
        found = self.friction("tendon1_path")
        self.assertAlmostEqual(found, (pull - release) / 2, delta=2e-4)
        self.assertIn(f"{found:.3g}", self.left_out)


def hinges(q):
    """Of u x y x u: the quaternion of the unit's rotation, taken apart."""
    out = []
    for u, v in np.reshape(q, (-1, 2)):
        angle = np.hypot(u, v)
        x, y = -v / angle * np.sin(angle / 2), u / angle * np.sin(angle / 2)
        out += [np.arctan2(y, np.cos(angle / 2)), -np.arcsin(x)]
    return out


class Urdf(unittest.TestCase):
    def test_chain_and_inertias(self):
        for name in ("rig_90mm", "two_section"):
            robot = yaml.safe_load((ROBOTS / f"{name}.yaml").read_text())
            with tempfile.TemporaryDirectory() as folder:
                file = pathlib.Path(folder) / "robot.urdf"
                tendril("model", "export", "--robot", ROBOTS / f"{name}.yaml", "--urdf", file)
                model = mujoco.MjModel.from_xml_path(str(file))
            units = sum(units_of(robot))
            q = np.random.default_rng(4).uniform(-0.4, 0.4, 2 * units)
            names = [f"u{i // 2 + 1}" if i % 2 == 0 else f"v{i // 2 + 1}" for i in range(2 * units)]
            done = subprocess.run(
                [TENDRIL, "model", "fk", "--robot", ROBOTS / f"{name}.yaml"],
                capture_output=True,
                text=True,
                input=",".join(names) + "\n" + ",".join(map(repr, map(float, q))),
                check=True,
            )
            expected = np.array(list(csv.reader(io.StringIO(done.stdout)))[1][:7], float)
            data = mujoco.MjData(model)
            for i, angle in enumerate(hinges(q)):
                joint = f"unit{i // 2 + 1}_{'uv'[i % 2]}"
                data.joint(joint).qpos = data.joint(joint + "_end").qpos = angle
            mujoco.mj_kinematics(model, data)
            last = model.body(f"unit{units}_u_end_link").id
            tip = data.xpos[last] + data.xmat[last].reshape(3, 3)[:, 2] * (
                straight_tip(robot)[2] - self.at_rest(model, last)
            )
            self.assertLess(np.linalg.norm(tip - expected[:3]), 2e-4 * straight_tip(robot)[2])
            turned = np.zeros(4)
            mujoco.mju_mat2Quat(turned, data.xmat[last])
            self.assertAlmostEqual(abs(turned @ expected[3:7]), 1, places=9)
            self.assertAlmostEqual(
                sum(model.body_mass), sum(s["units"] * s["unit_mass_kg"] for s in robot["body"]["sections"])
            )

    @staticmethod
    def at_rest(model, body):
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return data.xpos[body][2]


class WrongUse(unittest.TestCase):
    def refused(self, words, expected, status=2):
        done = tendril("model", "export", *words, status=status)
        self.assertRegex(done.stderr, expected)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)

    def test_one_line_and_nothing_lost(self):
        rig, body = ROBOTS / "rig_60mm.yaml", ROBOTS / "qi2021_60mm.yaml"
        with tempfile.TemporaryDirectory() as folder:
            there = pathlib.Path(folder) / "there.xml"
            there.write_text("mine")
            new = there.with_name("new.xml")
            self.refused(["--robot", rig], "give --mjcf FILE")
            self.refused(["--robot", rig, "--mjcf", there], "already exists; give another name, or --overwrite")
            for same in (new, f"{new.parent}/./{new.name}", os.path.relpath(new)):
                self.refused(["--robot", rig, "--mjcf", new, "--urdf", same], "two names")
            self.refused(
                ["--robot", body, "--mjcf", new, "--actuators", "motors"], "has no actuation; accepted: tensions"
            )
            self.refused(["--robot", rig, "--mjcf", new.parent / "no" / "such.xml"], "cannot write", status=1)
            self.refused(["--robot", rig, "--mjcf", folder], "cannot write|is a folder|directory", status=1)
            self.refused(
                ["--robot", folder + "/none.yaml", "--mjcf", new], "cannot read|does not exist|No such file", status=1
            )
            self.assertEqual(there.read_text(), "mine")
            self.assertFalse(new.exists())
            tendril("model", "export", "--robot", rig, "--mjcf", there, "--overwrite")
            self.assertIn("<mujoco", there.read_text())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
