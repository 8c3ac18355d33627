"""The JSON Schemas against what the files' loaders accept: the shipped files, and each key changed in turn.

Usage: schema_test.py TENDRIL JUDGE PROJECT_SOURCE_DIR. An independent validator (jsonschema) judges by the schemas, an
independent YAML 1.2 reader (ruamel.yaml) reads the shipped files; JUDGE (judge.cpp) says what the loaders think.
"""

import copy
import glob
import json
import subprocess
import sys

try:
    import jsonschema
    import ruamel.yaml
except ImportError as missing:
    print(f"skipped: {missing.name} is missing (tests/requirements.txt; tools/test fetches it)")
    sys.exit(77)

TENDRIL, JUDGE, SOURCE = sys.argv[1:4]
SCHEMAS = {}
for kind in ("robot", "daemon"):
    text = subprocess.run([TENDRIL, "config", "schema", kind], check=True, capture_output=True, text=True).stdout
    SCHEMAS[kind] = json.loads(text)
    jsonschema.Draft7Validator.check_schema(SCHEMAS[kind])
VALIDATORS = {kind: jsonschema.Draft7Validator(schema) for kind, schema in SCHEMAS.items()}


def load(path):
    """A file as JSON has it: keys are text."""
    return json.loads(json.dumps(ruamel.yaml.YAML(typ="safe", pure=True).load(open(path, encoding="utf-8"))))


def valid(kind, document):
    return VALIDATORS[kind].is_valid(document)


def refusals(kind, documents):
    """What the loader says of each document: empty where it accepts it. JSON is YAML."""
    lines = "".join(f"{kind} {json.dumps(document)}\n" for document in documents)
    answers = subprocess.run([JUDGE], input=lines, capture_output=True, text=True, check=True).stdout.split("\n")
    assert len(answers) == len(documents) + 1
    return answers[:-1]


def refusal(kind, document):
    return refusals(kind, [document])[0]


# ---- documents in which every key occurs ----

def full_robot():
    robot = load(SOURCE + "/config/robots/rig_60mm.yaml")
    robot["body"].update(
        tip_payload_kg=0.001, twist_rad_per_m=0.1, tip_force_W_N=[0, 0, 0.01],
        unit_deviations=[{"unit": 1, "stiffness_scale": 1.1, "rest_u_rad": 0.01, "rest_v_rad": 0.01}])
    robot["effects"] = [{"effect": "backlash", "where": "tendon:1", "rad": 0.01}]
    robot["actuation"].update(nodes=[1, 2, 3], per_tendon={"2": {"gear": {"efficiency": 0.8}}})
    robot["actuation"]["motor"]["torque_scale"] = 1
    robot["actuation"]["transmission"]["coulomb_N"] = 0
    robot["actuation"]["load_cell"]["offset_N"] = 0
    return robot


def full_robot_by_inertias():
    robot = full_robot()
    section = robot["body"]["sections"][0]
    del section["disk_diameter_m"]
    section.update(disk_inertia_xx_kgm2=1.6e-8, disk_inertia_zz_kgm2=3.1e-8)
    del robot["actuation"]["per_tendon"]
    return robot


def strained_robot():
    """The keys of a section that twists and stretches, by Poisson's ratio."""
    robot = full_robot()
    robot["body"]["sections"][0].update(
        units_per_disk=2, disk_mass_kg=0.001, strains=["bending", "torsion", "extension", "shear"],
        poissons_ratio=0.3, axial_stiffness_N=1e4, shear_damping_Nspm=1, torsional_damping_Nms=1e-6, axial_damping_Nspm=1, rest_torsion_rad_per_m=1,
        rest_extension=0.01)
    return robot


def strained_robot_by_stiffness():
    robot = strained_robot()
    section = robot["body"]["sections"][0]
    del section["poissons_ratio"]
    section.update(torsional_stiffness_Nm2=1e-3, shear_stiffness_N=5e3)
    return robot


def full_daemon():
    daemon = load(SOURCE + "/config/tendrild.yaml")
    daemon["bus"]["nodes"][0].update(motor="normal", encoder="normal", profile="epos4")
    return daemon


def foreign_daemon():
    daemon = full_daemon()
    daemon["bus"]["nodes"][0].update(profile="cia402", eds="drive.eds", analog_input="0x6401:01", analog_mV_per_count=2.5)
    return daemon


# ---- each key in turn ----

def places(schema, document, path=()):
    """(path, schema of the value) of all keys of the document, of lists their first entry."""
    for key, inner in schema.get("properties", {}).items():
        if key not in document:
            continue
        yield path + (key,), inner
        value = document[key]
        if inner.get("type") == "object":
            for pattern in inner.get("patternProperties", {}).values():
                yield from places(pattern, value["2"], path + (key, "2"))
            yield from places(inner, value, path + (key,))
        elif inner.get("type") == "array" and isinstance(value[0], dict):
            yield from places(inner["items"], value[0], path + (key, 0))


def with_value(document, path, change):
    changed = copy.deepcopy(document)
    at = changed
    for step in path[:-1]:
        at = at[step]
    change(at, path[-1])
    return changed


def just_beyond(value, sign, whole):
    return value + sign if whole else value + sign * max(abs(value), 1e-12) * 1e-6


def number_type(schema):
    """number or integer; of a robot file's, which may be a mapping with `within`, that of the value."""
    types = schema.get("type")
    return types[0] if isinstance(types, list) else types


def numbers(limits):
    """(value, within the range) at and beyond both ends."""
    whole = number_type(limits) == "integer"
    if "enum" in limits:
        yield from ((n, True) for n in limits["enum"])
        return
    low = limits.get("minimum", limits.get("exclusiveMinimum"))
    if "minimum" in limits:
        yield low, True
    else:
        yield low, False
    yield just_beyond(low, -1, whole), False
    yield limits["maximum"], True
    yield just_beyond(limits["maximum"], 1, whole), False


TEXTS = ["", "a", "all", "can0", "tendon:2", "tendon:", "tendon:x", "a b", "ä", "x" * 16, "x" * 41, "x" * 65, "a.b-c_d", "/var/x",
         "var/x", "a\tb", "0x6401:01", "0x640:01", "0x6401:1", "0xG401:01", "udpm://239.255.76.67:7667?ttl=0",
         "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=100", "udpm://10.0.0.1:7667?ttl=0", "udpm://239.255.76.67",
         "udpm://239.255.76.67:7667?ttl=0&", "memq://", "http://x"]


WITHINS = [("10 %", True), ("2.5%", True), ("known", True), ("unknown", True), ("1e1 %", True), ("0.5", False), ("about 1 %", False),
           ("-1 %", False), ("%", False), ("", False), (0, False), (-1, False), (True, False), ([1], False), (None, False)]


def uncertain_cases(key, limits, put):
    """(changed document, words of the refusal, whether it is accepted) where the number says how well it is known."""
    for value, within in numbers(limits):
        yield put({"value": value, "within": "known"}), "out of range", within
    good = limits["maximum"]
    every = key in ("youngs_modulus_Pa", "units", "gravity_W_mps2", "gain_VpN")
    for text, accepted in WITHINS if every else (WITHINS[0], WITHINS[6]):
        yield put({"value": good, "within": text}), "within: ", accepted
    yield put({"value": good}), "out of range", True
    yield put({"value": good, "within": good * 0.1}), "within: ", True
    yield put({"within": "10 %"}), "value: missing", False
    yield put({"value": good, "within": "10 %", "a": 1}), "unknown key", False


def cases(document, path, schema):
    """(changed document, words of the refusal that belong to the change, whether it is within what is accepted)."""
    def put(value):
        return with_value(document, path, lambda at, key: at.__setitem__(key, value))
    kind = schema.get("type")
    listed = kind == "array" and schema["items"].get("type") != "object"
    limits = schema["items"] if listed else schema
    count = {"nodes": 3}.get(path[-1], schema.get("minItems", 1))
    if number_type(limits) in ("number", "integer"):
        if path[-1] in ("gain_VpN", "resolution_V"):  # their range depends on `place`
            limits = dict(limits, minimum=1e-6)
        for value, within in numbers(limits):
            yield put([value] * count if listed else value), "out of range", within
        yield put(["x"] * count if listed else "x"), "is ", False
        yield put({"a": 1}), "is ", False
        if isinstance(limits["type"], list):
            yield from uncertain_cases(path[-1], limits, lambda value: put([value] * count if listed else value))
    elif "enum" in limits:
        for choice in limits["enum"]:
            yield put([choice] if listed else choice), "is not known", True
        yield put(["no_such_choice"] if listed else "no_such_choice"), "is not known", False
    elif limits.get("type") == "boolean":
        yield put("maybe"), "neither true", False
    elif limits.get("type") == "string":
        for text in TEXTS:
            yield put(text), "is not accepted", None
    elif kind == "object" and "patternProperties" not in schema:
        yield with_value(document, path, lambda at, key: at[key].__setitem__("no_such_key", [1])), "", False
    elif kind == "array" and not listed:
        yield put([]), "entries", schema["minItems"] == 0
        yield with_value(document, path, lambda at, key: at[key][0].__setitem__("no_such_key", [1])), "", False
    yield put(None), "no value", False


def difference(kind, path, document, words, within, refused):
    """One line where schema and loader differ."""
    schema_valid = valid(kind, document)
    where = f"{kind} {'/'.join(map(str, path))}"
    if within is None:  # of a text only the loader knows
        within = words not in refused
    if schema_valid != within:
        return f"{where}: schema says {schema_valid}, expected {within}: {refused or 'accepted'}"
    if within and words in refused and path[-1] in refused:
        return f"{where}: valid, but refused: {refused}"
    if not within and (not refused or words not in refused):
        return f"{where}: not valid, but the loader says {refused or 'nothing'}"
    return ""


SEEN = set()


def every_key(kind, document):
    """Each key that no earlier document had: changed, and left out."""
    assert valid(kind, document), list(VALIDATORS[kind].iter_errors(document))
    assert refusal(kind, document) == "", refusal(kind, document)
    changes = []
    for path, schema in places(SCHEMAS[kind], document):
        if (kind, path) in SEEN:
            continue
        SEEN.add((kind, path))
        changes += [(path, *case) for case in cases(document, path, schema)]
        if path != ("bus", "identity"):  # whether it is needed depends on the drives
            changes.append((path, with_value(document, path, lambda at, key: at.__delitem__(key)), "missing", None))
    answers = refusals(kind, [change[1] for change in changes])
    lines = [difference(kind, *change, answer) for change, answer in zip(changes, answers)]
    print(f"{kind}: {len(changes)} changes")
    return [line for line in lines if line]


def shipped_files():
    """Every file that is shipped is valid as its kind, and as nothing else."""
    wrong, count = [], 0
    for path in sorted(glob.glob(SOURCE + "/config/**/*.yaml", recursive=True) + glob.glob(SOURCE + "/examples/*.yaml")):
        document = load(path)
        kind = "robot" if "body" in document else "daemon" if "bus" in document else None
        for other in SCHEMAS:
            if valid(other, document) != (other == kind):
                wrong.append(f"{path}: as a {other} file {'not ' if other == kind else ''}valid")
        count += kind is not None
    assert count >= 10, count
    return wrong


def tendons_that_differ():
    """What each tendon gives the common blocks need not."""
    robot = full_robot()
    motor = robot["actuation"].pop("motor")
    robot["actuation"]["per_tendon"] = {str(j): {"motor": motor} for j in (1, 2, 3)}
    wrong = [] if valid("robot", robot) and not refusal("robot", robot) else ["a motor for each tendon is refused"]
    robot["actuation"]["per_tendon"] = {"0": {"motor": motor}}
    return wrong + (["tendon 0 is accepted"] if valid("robot", robot) else [])


def no_load_cell():
    """A cell that is not there has no numbers, or zeros; one that is there has."""
    wrong = []
    for place in ("none", "motor_side"):
        for cell in ({"place": place}, {"place": place, "gain_VpN": 0, "resolution_V": 0, "noise_N": 0}):
            robot = full_robot_by_inertias()
            robot["actuation"]["load_cell"] = cell
            accepted = refusal("robot", robot) == ""
            if accepted != (place == "none") or valid("robot", robot) != accepted:
                wrong.append(f"load cell {cell}: the loader {accepted}, schema {valid('robot', robot)}")
        robot = full_robot_by_inertias()
        robot["actuation"]["load_cell"] = {"place": place, "gain_VpN": {"value": 0, "within": "known"}, "resolution_V": 0.1, "noise_N": 0}
        if (valid("robot", robot), refusal("robot", robot) == "") != (place == "none",) * 2:
            wrong.append(f"load cell {place} with an uncertain gain of 0: schema {valid('robot', robot)}")
    return wrong


def parameters_of_effects():
    """An effect's numbers may say how well they are known, as others may."""
    wrong = []
    for number, accepted in ((0.01, True), ({"value": 0.01, "within": "10 %"}, True), ({"value": 0.01, "within": "x"}, False),
                             ({"within": "10 %"}, False)):
        robot = full_robot()
        robot["effects"][0]["rad"] = number
        if (valid("robot", robot), refusal("robot", robot) == "") != (accepted,) * 2:
            wrong.append(f"rad of an effect: {number}: schema {valid('robot', robot)}, the loader: {refusal('robot', robot)}")
    return wrong


def main():
    wrong = shipped_files() + tendons_that_differ() + no_load_cell() + parameters_of_effects()
    wrong += every_key("robot", full_robot_by_inertias())
    wrong += every_key("robot", full_robot())
    wrong += every_key("robot", strained_robot())
    wrong += every_key("robot", strained_robot_by_stiffness())
    wrong += every_key("daemon", full_daemon())
    wrong += every_key("daemon", foreign_daemon())
    print("\n".join(wrong))
    sys.exit(1 if wrong else 0)


main()
