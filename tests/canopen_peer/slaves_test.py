"""An independent CANopen implementation (Python's canopen) as the drives of our master, on a real vcan0.

The slaves are canopen.LocalNode made from our EDS; what a drive does beyond that (CiA 402, the rules of remapping) is
written here from the standards. Usage: slaves_test.py MASTER_PROGRAM EDS. Ends with 77, which ctest shows as skipped,
where canopen or vcan0 is missing.
"""

import os
import queue
import struct
import subprocess
import sys
import threading
import time
import unittest

if not os.path.exists("/sys/class/net/vcan0"):
    print("skipped: no vcan0 here; run under tools/vcan-run")
    sys.exit(77)
try:
    import canopen
except ImportError:
    print("skipped: Python's canopen is not installed; see tests/requirements.txt")
    sys.exit(77)

MASTER = EDS = None
PATIENCE_S = 20

# CiA 402: what a controlword's low bits lead to, from each state (by its statusword).
SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED, FAULT = 0x40, 0x21, 0x23, 0x27, 0x08
VOLTAGE_OFF, SHUTDOWN, SWITCH_ON, ENABLE = "voltage off", "shutdown", "switch on", "enable"
TRANSITIONS = {
    (SWITCH_ON_DISABLED, SHUTDOWN): READY,
    (READY, SWITCH_ON): SWITCHED_ON,
    (READY, ENABLE): SWITCHED_ON,
    (READY, VOLTAGE_OFF): SWITCH_ON_DISABLED,
    (SWITCHED_ON, ENABLE): ENABLED,
    (SWITCHED_ON, SHUTDOWN): READY,
    (SWITCHED_ON, VOLTAGE_OFF): SWITCH_ON_DISABLED,
    (ENABLED, SWITCH_ON): SWITCHED_ON,
    (ENABLED, SHUTDOWN): READY,
    (ENABLED, VOLTAGE_OFF): SWITCH_ON_DISABLED,
}


def command_of(controlword):
    if not controlword & 0x02:
        return VOLTAGE_OFF
    return {0x6: SHUTDOWN, 0x7: SWITCH_ON, 0xF: ENABLE}.get(controlword & 0x0F)


class Slave:
    """One drive: a LocalNode, the walk through CiA 402, and a record of what the master did."""

    def __init__(self, network, node_id, refuse=None, eds=None):
        self.node = canopen.LocalNode(node_id, eds or EDS)
        self.id = node_id
        self.network = network
        self.writes = []  # (index, sub, value), in order
        self.broken_rules = []
        self.torques = []  # that came in operation enabled, at SYNC
        self.refuse = refuse
        self.state = SWITCH_ON_DISABLED
        self.previous_controlword = 0
        self.received = None
        self.sent_status = None
        self.alive = True
        self.lock = threading.Lock()
        network.add_node(self.node)
        self.node.add_write_callback(self.on_write)
        network.subscribe(0x200 + node_id, self.on_rpdo)
        network.subscribe(0x80, self.on_sync)
        self.prepare()
        self.boot()

    def prepare(self):
        """Values of a drive that is not set up for its motor yet."""
        self.set(0x3001, 1, 0)

    # ---- objects ----

    def entry(self, index, sub):
        return self.node._find_object(index, sub)

    def get(self, index, sub=0):
        return self.entry(index, sub).decode_raw(self.node.get_data(index, sub))

    def set(self, index, sub, value):
        """As the drive itself would, without any of the rules for the bus."""
        self.node.data_store.setdefault(index, {})[sub] = self.entry(index, sub).encode_raw(value)

    def on_write(self, index, subindex, od, data):
        value = od.decode_raw(bytes(data))
        self.writes.append((index, subindex, value))
        if (index, subindex) == self.refuse:
            raise canopen.SdoAbortedError(0x06090030)
        if 0x1600 <= index < 0x1604 or 0x1A00 <= index < 0x1A04:
            self.check_mapping(index, subindex, value)
        if index == 0x6060:
            self.set(0x6061, 0, value)
        self.follow(index, subindex, value)

    def follow(self, index, subindex, value):
        if index == 0x3001:  # rated torque, as the drive computes it
            values = {sub: self.get(0x3001, sub) for sub in (1, 5)}
            values[subindex] = value
            self.set(0x6076, 0, values[1] * values[5] // 1000)

    def check_mapping(self, index, sub, value):
        """CiA 301: a mapping may change while its PDO does not exist; entries while their number is 0."""
        if self.get(index - 0x200, 1) & 0x80000000 == 0:
            self.broken_rules.append(f"{index:04X}:{sub} written while the PDO exists")
        if sub != 0 and self.get(index, 0) != 0:
            self.broken_rules.append(f"{index:04X}:{sub} written while entries are in force")
        if sub == 0 and value != 0:
            for entry in range(1, value + 1):
                mapped = self.get(index, entry)
                od = self.entry(mapped >> 16, (mapped >> 8) & 0xFF)
                if not od.pdo_mappable or len(od) != mapped & 0xFF:
                    raise canopen.SdoAbortedError(0x06040041)

    # ---- NMT ----

    def boot(self):
        """What a reset does; the library leaves it to the application."""
        with self.lock:
            self.state, self.received, self.sent_status = SWITCH_ON_DISABLED, None, None
        for index in [i for i in self.node.data_store if 0x1000 <= i < 0x2000 and i != 0x1018]:
            del self.node.data_store[index]
        self.node.nmt.stop_heartbeat()
        self.node.nmt.state = "INITIALISING"  # sends the boot-up message
        self.node.nmt.state = "PRE-OPERATIONAL"

    # ---- the cycle ----

    def on_rpdo(self, can_id, data, timestamp):
        with self.lock:
            self.received = bytes(data)

    def on_sync(self, can_id, data, timestamp):
        if not self.alive or self.node.nmt.state != "OPERATIONAL":
            return
        with self.lock:
            received, self.received = self.received, None
        if received is not None:
            self.act(received)
        self.send_pdo(0x1A00)
        status = self.state | 0x0210
        if status != self.sent_status:
            self.sent_status = status
            self.set(0x6041, 0, status)
            self.send_pdo(0x1A01)

    def act(self, received):
        at = 0
        for entry in range(1, self.get(0x1600, 0) + 1):
            mapped = self.get(0x1600, entry)
            size = (mapped & 0xFF) // 8
            self.node.data_store.setdefault(mapped >> 16, {})[(mapped >> 8) & 0xFF] = received[at : at + size]
            at += size
        controlword = self.get(0x6040)
        if self.state == FAULT:
            if controlword & 0x80 and not self.previous_controlword & 0x80:
                self.state = SWITCH_ON_DISABLED
        else:
            self.state = TRANSITIONS.get((self.state, command_of(controlword)), self.state)
        self.previous_controlword = controlword
        if self.state == ENABLED:
            self.torques.append(self.get(0x6071))
            self.set(0x6077, 0, self.get(0x6071))

    def send_pdo(self, mapping):
        data = b""
        for entry in range(1, self.get(mapping, 0) + 1):
            mapped = self.get(mapping, entry)
            data += self.node.get_data(mapped >> 16, (mapped >> 8) & 0xFF)
        self.network.send_message(self.get(mapping - 0x200, 1) & 0x7FF, data)

    def fail(self, code, register):
        """To fault, with an emergency message."""
        self.state = FAULT
        self.set(0x603F, 0, code)
        self.node.emcy.send(code, register)

    def die(self):
        self.alive = False
        self.node.nmt.stop_heartbeat()
        self.network.unsubscribe(self.node.sdo.rx_cobid, self.node.sdo.on_request)

    def revive(self):
        self.alive = True
        self.network.subscribe(self.node.sdo.rx_cobid, self.node.sdo.on_request)
        self.boot()


class Bench(unittest.TestCase):
    """Slaves on vcan0 and the master that drives them."""

    def make_slave(self, node_id, refuse):
        return Slave(self.network, node_id, refuse)

    def start(self, count=2, refuse=None, product=None, master=()):
        self.network = canopen.Network()
        self.network.connect(interface="socketcan", channel="vcan0")
        self.addCleanup(self.network.disconnect)
        self.slaves = [self.make_slave(i, refuse if i == 1 else None) for i in range(1, count + 1)]
        if product:
            self.slaves[0].set(0x1018, 2, product)
        for slave in self.slaves:
            self.addCleanup(slave.node.nmt.stop_heartbeat)
        self.network.subscribe(0, self.on_nmt)
        self.lines, self.seen, self.states = queue.Queue(), [], {}
        self.master = subprocess.Popen(
            [MASTER, "vcan0", str(count), *master], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        threading.Thread(target=self.read_master, args=(self.master.stdout,), daemon=True).start()
        self.addCleanup(self.stop_master)

    def on_nmt(self, can_id, data, timestamp):
        for slave in self.slaves:
            if slave.alive and data[1] in (0, slave.id) and data[0] in (0x81, 0x82):
                slave.boot()

    def read_master(self, out):
        for line in out:
            self.lines.put(line.rstrip("\n"))

    def stop_master(self):
        self.master.stdin.close()
        self.master.wait(10)

    def tell(self, line):
        self.master.stdin.write(line + "\n")
        self.master.stdin.flush()

    def take_lines(self):
        while not self.lines.empty():
            line = self.lines.get()
            self.seen.append(line)
            words = line.split()
            if words[0] == "state":
                self.states[int(words[1])] = words[2]

    def wait_for(self, condition, what):
        end = time.monotonic() + PATIENCE_S
        while True:
            self.take_lines()
            if condition():
                return
            if time.monotonic() > end:
                self.fail(f"{what}; the master said:\n" + "\n".join(self.seen))
            time.sleep(0.005)

    def wait_for_all(self, state):
        everyone = {slave.id: state for slave in self.slaves}
        self.wait_for(lambda: self.states == everyone, f"all {state}")

    def events(self, node, status):
        return [line for line in self.seen if line.startswith(f"event {node} {status} ")]


class Slaves(Bench):
    def test_boots_checks_and_maps_in_the_order_of_the_standard(self):
        self.start()
        self.wait_for_all("ready")
        for slave in self.slaves:
            self.assertEqual(slave.broken_rules, [])
            self.assertEqual(slave.node.nmt.state, "OPERATIONAL")
            self.assertEqual(slave.get(0x6060), 10)
            writes = slave.writes
            for communication, mapping in ((0x1400, 0x1600), (0x1800, 0x1A00), (0x1801, 0x1A01)):
                steps = [w for w in writes if w[0] in (communication, mapping)]
                order = [(w[0], w[1]) for w in steps if (w[0], w[1]) != (communication, 3)]
                count = steps[-2][2]
                self.assertEqual(
                    order,
                    [(communication, 1), (communication, 2), (mapping, 0)]
                    + [(mapping, i + 1) for i in range(count)]
                    + [(mapping, 0), (communication, 1)],
                )
                self.assertTrue(steps[0][2] & 0x80000000)
                self.assertFalse(steps[-1][2] & 0x80000000)
            for unused in (0x1401, 0x1402, 0x1403, 0x1802, 0x1803):
                self.assertTrue(slave.get(unused, 1) & 0x80000000, f"{unused:04X}")
            # Both ways: the drive watches the master, the master the drive.
            self.assertEqual(slave.get(0x1016, 1), 127 << 16 | 1000)
            self.assertEqual(slave.get(0x1017), 100)
            at = {(w[0], w[1]): k for k, w in enumerate(writes)}
            self.assertLess(at[0x6040, 0], at[0x3001, 1], "power off before the motor's data change")
        self.assertEqual(len(self.events(1, 0)), 1, "configured once")

    def test_enables_and_turns_torque_each_cycle(self):
        self.start()
        self.wait_for_all("ready")
        self.assertEqual([s.state for s in self.slaves], [SWITCH_ON_DISABLED] * 2, "nothing is enabled untold")
        self.tell("torque 150")
        self.tell("enable")
        self.wait_for_all("enabled")
        before = [len(s.torques) for s in self.slaves]
        began = time.monotonic()
        self.wait_for(lambda: all(len(s.torques) > n + 100 for s, n in zip(self.slaves, before)), "torques")
        self.assertLess(time.monotonic() - began, 10, "100 cycles of 10 ms")
        self.assertEqual([s.torques[-1] for s in self.slaves], [150, 300])
        for slave in self.slaves:
            slave.set(0x6064, 0, -1000 * slave.id)
            slave.set(0x3160, 1, 700 + slave.id)
        time.sleep(0.3)
        self.tell("feedback 1")
        self.wait_for(lambda: "feedback -2000 300 702" in self.seen, "feedback")
        self.tell("disable")
        self.wait_for_all("ready")
        self.assertNotEqual(self.slaves[0].state, ENABLED)
        count = [len(s.torques) for s in self.slaves]
        time.sleep(0.2)
        self.assertEqual([len(s.torques) for s in self.slaves], count, "no torque after disable")

    def test_a_lost_node_is_noticed_and_comes_back_only_when_told(self):
        self.start()
        self.wait_for_all("ready")
        self.tell("enable")
        self.wait_for_all("enabled")
        self.slaves[1].die()
        died = time.monotonic()
        self.wait_for(lambda: self.states[2] == "offline", "node 2 lost")
        self.assertLess(time.monotonic() - died, 3, "heartbeat time-out of 1 s")
        self.assertEqual(len(self.events(2, 401)), 1)
        self.assertEqual(self.states[1], "enabled", "what the others do is the controller's choice")
        self.slaves[1].revive()
        time.sleep(1)
        self.take_lines()
        self.assertEqual(self.states[2], "offline")
        self.tell("disable")
        self.tell("clear")
        self.wait_for_all("ready")
        self.tell("enable")
        self.wait_for_all("enabled")

    def test_a_fault_is_told_with_its_code_and_reset_when_told(self):
        self.start()
        self.wait_for_all("ready")
        self.tell("enable")
        self.wait_for_all("enabled")
        self.slaves[0].fail(0x2310, 0x02)
        self.wait_for(lambda: self.states[1] == "fault", "fault")
        self.assertTrue(any("EMCY 0x2310" in line for line in self.events(1, 402)))
        time.sleep(0.3)
        self.assertEqual(self.slaves[0].state, FAULT, "no reset untold")
        self.tell("disable")
        self.tell("clear")
        self.wait_for_all("ready")
        self.tell("enable")
        self.wait_for_all("enabled")

    def test_a_refused_value_fails_the_boot_by_node_object_value_and_reason(self):
        self.start(refuse=(0x605E, 0))
        self.wait_for(lambda: self.states.get(2) == "ready", "the other one")
        self.wait_for(lambda: self.events(1, 407), "the boot of node 1 fails")
        said = self.events(1, 407)[0]
        for part in ("node 1", "stop reactions", "605E:00 = 0", "06090030"):
            self.assertIn(part, said)

    def test_a_foreign_device_is_refused(self):
        self.start(product=0x12345678)
        self.wait_for(lambda: self.events(1, 408), "a mismatch")
        self.assertIn("1018:02", self.events(1, 408)[0])
        self.assertEqual(self.slaves[0].writes, [], "it was not touched")


if __name__ == "__main__":
    MASTER, EDS = sys.argv[1:3]
    del sys.argv[1:3]
    unittest.main(verbosity=2, warnings="ignore")  # the library leaves the EDS file open
