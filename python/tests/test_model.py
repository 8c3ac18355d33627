"""The model: results equal those of `tendril model` bit for bit, one row and many, and what is wrong is said."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import tendril

from conftest import ROBOTS, program

FILES = ["rig_60mm.yaml", "two_section.yaml", "four_tendon_90mm.yaml"]


@pytest.fixture(params=FILES, scope="module")
def file(request):
    return ROBOTS / request.param


@pytest.fixture(scope="module")
def model(file):
    return tendril.Model(tendril.load_robot(file))


def states(model, count=40, seed=1):
    random = np.random.default_rng(seed)
    n, m = 2 * model.robot.units, model.robot.tendons
    return (
        0.1 * random.standard_normal((count, n)),
        random.standard_normal((count, n)),
        random.random((count, m)),
    )


def evaluated(what, file, names, table):
    """Columns of `tendril model WHAT` for the table's rows; both texts are exact."""
    lines = [",".join(names)] + [",".join(repr(float(x)) for x in row) for row in table]
    out = program("model", *what.split(), "--robot", file, text="\n".join(lines) + "\n").splitlines()
    return np.array([[float(x) for x in line.split(",")] for line in out[1:]])


def pairs(a, b, count):
    return [f"{x}{i}" for i in range(1, count + 1) for x in (a, b)]


def tensions(model):
    return [f"T{j}" for j in range(1, model.robot.tendons + 1)]


def test_equals_the_command_line(file, model):
    q, dq, tension = states(model)
    units = model.robot.units
    accel = evaluated(
        "accel",
        file,
        pairs("u", "v", units) + pairs("du", "dv", units) + tensions(model),
        np.hstack([q, dq, tension]),
    )
    assert np.array_equal(model.forward_dynamics(q, dq, tension), accel)
    tip = model.fk(q)
    fk = evaluated("fk", file, pairs("u", "v", units), q)
    assert np.array_equal(np.hstack([tip.position, tip.orientation, tip.tendon_lengths]), fk)
    statics = evaluated(
        "statics", file, tensions(model) + ["fx", "fy", "fz"], np.hstack([tension, 1e-3 * dq[:, :3]])
    )
    shape = model.statics(tension, 1e-3 * dq[:, :3])
    assert np.array_equal(np.hstack([shape, model.fk(shape).position]), statics)
    assert np.array_equal(
        model.frequencies(tension), evaluated("frequencies", file, tensions(model), tension)
    )
    mass = evaluated("mass", file, pairs("u", "v", units), q)
    assert np.array_equal(model.mass_matrix(q).reshape(len(q), -1), mass)
    energy = evaluated("energy", file, pairs("u", "v", units) + pairs("du", "dv", units), np.hstack([q, dq]))
    assert np.array_equal(model.energy(q, dq), energy)


def test_all_strains_equal_the_command_line():
    file = ROBOTS / "rod_5disks.yaml"
    model = tendril.Model(tendril.load_robot(file))
    names, disks, tendons = model.coordinates, 5, model.robot.tendons
    assert names[:7] == ["u1", "v1", "w1", "e1", "sx1", "sy1", "u2"] and len(names) == 6 * model.robot.units
    random = np.random.default_rng(2)
    q, dq = (
        scale * random.standard_normal((5, len(names))) * np.tile([1, 1, 0.3, 0.01, 0.01, 0.01], 10) for scale in (0.05, 1)
    )
    tension = random.random((5, tendons))
    rates = ["d" + name for name in names]
    accel = evaluated("accel", file, names + rates + tensions(model), np.hstack([q, dq, tension]))
    assert np.array_equal(model.forward_dynamics(q, dq, tension), accel)
    tip = model.fk(q)
    assert np.array_equal(
        np.hstack([tip.position, tip.orientation, tip.tendon_lengths]), evaluated("fk", file, names, q)
    )
    shape = model.statics(tension)
    statics = evaluated("statics", file, tensions(model), tension)
    assert np.array_equal(np.hstack([shape, model.fk(shape).position]), statics)
    mass = evaluated("mass", file, names, q)
    assert np.array_equal(model.mass_matrix(q).reshape(5, -1), mass)
    assert model.jacobian(q).shape == (5, 6, len(names))
    frames, holes = model.disks(q), model.tendon_points(q)
    assert frames.shape == (5, disks + 1, 4, 4) and holes.shape == (5, tendons, disks + 1, 3)
    assert np.array_equal(frames[:, -1, :3, 3], tip.position)
    lengths = np.linalg.norm(np.diff(holes, axis=2), axis=-1).sum(-1)
    np.testing.assert_allclose(lengths, tip.tendon_lengths, rtol=1e-12)
    assert np.array_equal(model.backbone(q, 11)[:, -1], tip.position)
    for name, argument in (("inverse", [0.1, 0]), ("inverse_tip", [0, 0, 0.09]), ("ik", [0, 0, 0.09]), ("hinge_angles", q)):
        with pytest.raises(tendril.ConfigError, match=f"tendril.Model.{name} knows bending alone"):
            getattr(model, name)(argument)


def test_one_row_equals_its_row_of_many(model):
    q, dq, tension = states(model, 9)
    many = model.forward_dynamics(q, dq, tension)
    one = model.forward_dynamics(q[4], dq[4], tension[4])
    assert one.shape == (2 * model.robot.units,) and np.array_equal(one, many[4])
    assert np.array_equal(model.forward_dynamics(q, dq[4], tension)[4], many[4])
    assert model.jacobian(q[0]).shape == (6, 2 * model.robot.units)


def test_jacobian_is_the_derivative_of_the_tip(model):
    q = states(model, 1)[0][0]
    step = 1e-6
    for k in range(q.size):
        moved = np.array([q, q])
        moved[0, k] += step
        moved[1, k] -= step
        ends = model.fk(moved).position
        assert np.allclose(model.jacobian(q)[:3, k], (ends[0] - ends[1]) / (2 * step), atol=1e-8)


def test_points_of_the_shape_fit_each_other(model):
    q = states(model, 3)[0]
    disks, points, tip = model.disks(q), model.tendon_points(q), model.fk(q)
    assert np.allclose(disks[:, -1, :3, 3], tip.position, atol=1e-15)
    # Tendons are straight between disks: their polylines are as long as the model says.
    pieces = np.linalg.norm(np.diff(points, axis=2), axis=-1)
    assert np.allclose(np.nansum(pieces, axis=-1), tip.tendon_lengths, rtol=1e-12)
    backbone = model.backbone(q, points=2001)
    length = np.linalg.norm(np.diff(backbone, axis=1), axis=-1).sum(axis=-1)
    assert np.allclose(length, model.robot.length, rtol=1e-6)
    assert np.allclose(backbone[:, -1], tip.position, atol=1e-12) and not backbone[:, 0].any()


def test_wrong_arguments_say_what_is_expected(rig):
    model = tendril.Model(rig)
    with pytest.raises(ValueError, match=r"T has shape \(2,\); expected \(3,\) or \(N, 3\): tensions"):
        model.statics([1, 2])
    with pytest.raises(ValueError, match=r"T\[1, 2\] is nan; give finite numbers"):
        model.statics([[1, 2, 3], [1, 2, np.nan]])
    with pytest.raises(ValueError, match="tendons only pull"):
        model.frequencies([1, -2, 3])
    with pytest.raises(ValueError, match="dq has 3 rows and q 2"):
        n = 2 * rig.units
        model.forward_dynamics(np.zeros((2, n)), np.zeros((3, n)), np.zeros(3))
    with pytest.raises(ValueError, match="is str, not numbers"):
        model.fk("straight")
    with pytest.raises(ValueError, match="some values are masked"):
        model.statics(np.ma.masked_less([1.0, 2.0, 3.0], 2))
    for given in ([1, 2, 3j], ["1", "2", "3"], np.array(["2024-01-01"] * 3, dtype="M8[D]")):
        with pytest.raises(ValueError, match="T is .*, not numbers"):
            model.statics(given)
    with pytest.raises(ValueError, match=r"or one for all, of shape \(3,\)"):
        model.statics(np.ones((3, 3)), np.zeros((1, 3)))
    with pytest.raises(ValueError, match="points is 'many'; give a whole number from 2"):
        model.backbone(np.zeros(2 * rig.units), points="many")
    assert model.backbone(np.zeros(2 * rig.units), points=np.int64(3)).shape == (3, 3)
    for path in (b"none\xff", "none\udcff", "", "a\0b", None, 7):
        with pytest.raises(ValueError, match="path is .*; give a path"):
            tendril.load_robot(path)
    with pytest.raises(ValueError, match="give a Robot"):
        tendril.Model("rig")


def test_a_row_without_solution_is_named(rig):
    model = tendril.Model(rig)
    with pytest.raises(tendril.ModelError, match="row 1: no .*equilibrium.*lower the tensions") as error:
        model.statics([[1, 1, 1], [50, 50, 50]])
    assert error.value.row == 1
    with pytest.raises(tendril.ModelError, match="row 0: unit 1 is bent .*bend it less"):
        model.fk(np.full(2 * rig.units, 5.0))


def test_errors_come_back_from_another_process():
    """A multiprocessing.Pool whose worker raises what cannot be unpickled waits for ever."""
    for error in (
        tendril.ModelError("no stable equilibrium; lower the tensions", 3),
        tendril.ConfigError("robot.yaml:7: body.units: is missing; add it"),
        tendril.DaemonError("no daemon answers"),
    ):
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error) and str(again) == str(error) and vars(again) == vars(error)


def test_errors_of_files_name_file_line_and_key(tmp_path):
    text = (ROBOTS / "rig_60mm.yaml").read_text()
    assert "youngs_modulus_Pa:" in text
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace("youngs_modulus_Pa:", "youngs_modulus:", 1))
    with pytest.raises(tendril.ConfigError) as error:
        tendril.load_robot(path)
    assert error.value.file == str(path) and error.value.line and "youngs_modulus" in (error.value.key or "")
    with pytest.raises(tendril.ConfigError, match="No such file") as error:
        tendril.load_robot(tmp_path / "none.yaml")
    assert error.value.line is None and error.value.file == str(tmp_path / "none.yaml")


def test_inverse_equals_the_command_line(file, model):
    k, random = model.robot.sections, np.random.default_rng(2)
    bend, rate, acceleration = (0.3 * random.standard_normal((8, 2 * k)) for _ in range(3))
    names = pairs("us", "vs", k)
    moving = names + pairs("dus", "dvs", k) + pairs("ddus", "ddvs", k)
    assert np.array_equal(model.inverse(bend).tension, evaluated("inverse", file, names, bend))
    table = np.hstack([bend, rate, acceleration])
    assert np.array_equal(model.inverse(bend, rate, acceleration).tension, evaluated("inverse", file, moving, table))
    ours = model.inverse(bend, shape="equilibrium")
    theirs = evaluated("inverse --shape equilibrium", file, names, bend)
    assert np.array_equal(ours.tension, theirs) and ours.reached.shape == (8,)
    tips = model.fk(model.spread(0.7 * bend[:3])).position
    ours = model.inverse_tip(tips)
    theirs = evaluated("inverse-tip", file, ["x", "y", "z"], tips)
    assert np.array_equal(np.hstack([ours.tension, ours.q]), theirs)
    assert np.array_equal(model.ik(tips).bending, evaluated("ik", file, ["x", "y", "z"], tips))


def test_inverse_of_pairs_equals_the_command_line():
    path = ROBOTS / "pairs_90mm.yaml"
    model = tendril.Model(tendril.load_robot(path))
    bend = np.array([[1.0, 0.2], [-0.3, 0.6]])
    for shape in ("arc", "equilibrium"):
        tension = model.inverse(bend, shape=shape).tension
        theirs = evaluated(f"inverse --shape {shape}", path, ["us1", "vs1"], bend)
        assert np.array_equal(tension, theirs)
        # Both of a pair have less than their pretension of 4 N by what the bend takes, and differ by the pull.
        assert np.all(tension[:, 0] + tension[:, 2] < 8) and np.allclose(tension[:, 0] + tension[:, 2], 8, atol=0.4)


def test_inverse_of_what_was_found(rig):
    model = tendril.Model(rig)
    q = model.statics([2.0, 0.5, 0.5])
    found = model.inverse_tip(model.fk(q).position)
    assert found.reached and found.from_rest and np.allclose(found.q, q, atol=1e-6)
    assert np.allclose(model.fk(model.statics(found.tension)).position, model.fk(q).position, atol=1e-8)
    far = model.inverse([3.0, 0.0])
    assert not far.reached and far.missing > 0 and far.tension.max() == rig.max_tension_base
    with pytest.raises(ValueError, match="rate is given without acceleration"):
        model.inverse([0.1, 0.1], rate=[1, 1])
    with pytest.raises(ValueError, match="accepted: arc, equilibrium"):
        model.inverse([0.1, 0.1], shape="round")
    with pytest.raises(ValueError, match="min_tension is -1.0 N; give 0 to"):
        model.inverse([0.1, 0.1], min_tension=-1)


def test_exports_equal_the_commands(rig, tmp_path):
    mjcf, urdf = tmp_path / "robot.xml", tmp_path / "robot.urdf"
    program("model", "export", "--robot", ROBOTS / "rig_60mm.yaml", "--mjcf", mjcf, "--urdf", urdf, "--friction-at", 2)
    assert rig.to_mjcf(friction_at=2) == mjcf.read_text()
    assert rig.to_urdf() == urdf.read_text()
    assert rig.to_mjcf(actuators="tensions") == rig.to_mjcf(actuators="tensions", friction_at=5) != rig.to_mjcf()
    for wrong in ({"actuators": "muscles"}, {"friction_at": -1.0}, {"timestep": 0.0}, {"timestep": float("nan")}):
        with pytest.raises(ValueError, match="accepted"):
            rig.to_mjcf(**wrong)
    alone = tendril.load_robot(ROBOTS / "qi2021_60mm.yaml")
    with pytest.raises(ValueError, match="no actuation; accepted: tensions"):
        alone.to_mjcf(actuators="motors")


def test_hinges_turn_the_disk_as_the_arc_does(model):
    rng = np.random.default_rng(5)
    for size in (1e-9, 0.5, 3.0):
        q = np.zeros(2 * model.robot.units)
        q[:2] = rng.normal(size=2)
        q[:2] *= size / np.hypot(*q[:2])
        u, v = model.hinge_angles(q)[:2]
        cu, su, cv, sv = np.cos(u), np.sin(u), np.cos(2 * v), np.sin(2 * v)
        about_y = np.array([[cu, 0, su], [0, 1, 0], [-su, 0, cu]])
        about_minus_x = np.array([[1, 0, 0], [0, cv, sv], [0, -sv, cv]])
        np.testing.assert_allclose(about_y @ about_minus_x @ about_y, model.disks(q)[1, :3, :3], atol=1e-12)
