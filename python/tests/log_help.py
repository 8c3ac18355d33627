"""What the tests of log export and live bridge share: logs with every type of message and every number random, and
protobuf's own reader as the judge of what was written."""

import random

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from tendril import messages
from tendril.messages.fields import FIELDS

from view_help import START, run_message, state_message

COUNTS = {
    "num_tendons": 3,
    "num_drives": 3,
    "num_bending": 2,
    "num_covariance": 4,
    "num_bins": 3,
    "num_bytes": 5,
}
SMALL = ("boolean", "int8_t")  # flags and codes, of which a cycle's are checked


def value(kind, rng):
    if kind in ("double", "float"):
        return rng.choice([rng.gauss(0, 1), rng.gauss(0, 1e-9), float("nan"), -0.0])
    if kind == "string":
        return "".join(rng.choice('aß 漢;,"') for _ in range(rng.randrange(6)))
    if kind in SMALL:
        return rng.randrange(2)
    return rng.randrange(2**15)


def random_message(kind, time_s, rng):
    """Of any type, at a time since START; arrays whose length a robot does not set are of any length."""
    message = getattr(messages, kind)()
    counts = {}
    for name, of, count in FIELDS[kind]:
        if any(name == other for *_, other in FIELDS[kind]):
            counts[name] = COUNTS.get(name, rng.randrange(3))
            made = counts[name]
        elif count is None:
            made = value(of, rng)
        else:
            entries = [value(of, rng) for _ in range(counts.get(count, count))]
            made = bytes(e % 256 for e in entries) if of == "byte" else entries
        setattr(message, name, made)
    message.utime = START + round(1e6 * time_s)
    if kind == "cycle_t":
        message.time_ns = 1000 * (message.utime - START) + 10**9
        message.cycle = round(1e3 * time_s)
        message.orientation_estimate_WT = (1.0, 0.0, 0.0, 0.0)
    return message


def every_kind(n=60, seed=1):
    """A run, then all types in turn, as pairs of a channel's ending and a message; states can be drawn."""
    rng = random.Random(seed)
    found = [("RUN", run_message())]
    kinds = [kind for kind in FIELDS if kind not in ("run_t", "state_t", "snapshot_t")]
    for i in range(n):
        found.append(
            ("STATE", state_message(0.01 * i, bending=(0.02 * i, 0.1), mode="running" if i % 7 else "hold"))
        )
        found += [(kind.removesuffix("_t").upper(), random_message(kind, 0.01 * i, rng)) for kind in kinds]
    return found


class Reader:
    """Reads protobuf by the schema that came with it, with protobuf's own means."""

    def __init__(self):
        self._classes = {}

    def read(self, name, schema, data):
        if name not in self._classes:
            pool = descriptor_pool.DescriptorPool()
            for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
                pool.Add(file)
            self._classes[name] = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
        return self._classes[name].FromString(data)


def plain(value):
    """To compare: lists instead of other sequences, numbers and texts by how they are written, so that NaN is NaN."""
    if isinstance(value, (list, tuple)) or hasattr(value, "append"):
        return [plain(v) for v in value]
    return repr(int(value)) if isinstance(value, bool) else repr(value)


def fields(message):
    return {name: plain(getattr(message, name)) for name in message.__slots__}
