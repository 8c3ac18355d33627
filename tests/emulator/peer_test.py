"""An independent CANopen implementation (Python's canopen) as master of the emulated drives, on a real vcan0.

Usage: peer_test.py RACK_PROGRAM. Ends with 77, which ctest shows as skipped, where canopen or vcan0 is missing.
"""

import os
import subprocess
import sys
import tempfile
import time
import unittest

if not os.path.exists("/sys/class/net/vcan0"):
    print("skipped: no vcan0 here; run under tools/vcan-run")
    sys.exit(77)
try:
    import can
    import canopen
    from canopen.profiles.p402 import BaseNode402
except ImportError:
    print("skipped: Python's canopen is not installed; see tests/requirements.txt")
    sys.exit(77)

RACK = None
RATED_NM = 7056e-6


# The peer's own time-outs are for real time; the user-mode kernel shares one processor among all of this.
BaseNode402.TIMEOUT_SWITCH_STATE_SINGLE = BaseNode402.TIMEOUT_SWITCH_STATE_FINAL = 5
BaseNode402.TIMEOUT_CHECK_TPDO = 5
canopen.sdo.SdoClient.RESPONSE_TIMEOUT = 5


class Peer(unittest.TestCase):
    def setUp(self):
        eds = tempfile.NamedTemporaryFile(suffix=".eds")
        self.addCleanup(eds.close)
        self.rack = subprocess.Popen(
            [RACK, "vcan0", "2", eds.name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.addCleanup(self.stop_rack)
        self.network = canopen.Network()
        self.network.connect(interface="socketcan", channel="vcan0")
        self.addCleanup(self.network.disconnect)
        self.assertEqual(self.rack.stdout.readline(), "ready\n")
        self.node = BaseNode402(1, eds.name)
        self.network.add_node(self.node)
        self.boot_ups = 0
        self.network.subscribe(0x701, self.on_heartbeat)
        self.reset()

    def stop_rack(self):
        self.rack.stdin.close()
        self.rack.wait(5)
        self.rack.stdout.close()

    def on_heartbeat(self, can_id, data, timestamp):
        self.boot_ups += data[0] == 0

    def reset(self):
        seen = self.boot_ups
        self.node.nmt.send_command(0x81)
        self.wait_for(lambda: self.boot_ups > seen, "boot-up message")

    def tell(self, line):
        self.rack.stdin.write(line + "\n")
        self.rack.stdin.flush()
        return float(self.rack.stdout.readline())

    def wait_for(self, condition, what):
        end = time.monotonic() + 10
        while not condition():
            self.assertLess(time.monotonic(), end, what)
            time.sleep(0.002)

    def map_torque(self, status_type=255):
        node = self.node
        node.tpdo.read()
        node.rpdo.read()
        rpdo = node.rpdo[1]
        rpdo.clear()
        rpdo.add_variable(0x6040)
        rpdo.add_variable(0x6071)
        rpdo.trans_type = 1
        rpdo.enabled = True
        rpdo.save()
        feedback = node.tpdo[1]
        feedback.clear()
        for index, sub in ((0x6064, 0), (0x6077, 0), (0x3160, 1)):
            feedback.add_variable(index, sub)
        feedback.trans_type = 1
        feedback.enabled = True
        feedback.save()
        status = node.tpdo[2]
        status.clear()
        status.add_variable(0x6041)
        status.trans_type = status_type
        status.inhibit_time = 100
        status.enabled = True
        status.save()

    def test_identity_by_the_names_of_the_eds(self):
        sdo = self.node.sdo
        self.assertEqual(sdo[0x1018][1].raw, 0xFB)
        self.assertEqual(sdo["Device type"].raw, 0x00020192)
        self.assertEqual(sdo["Device name"].raw, "EPOS4")  # segmented
        self.assertEqual(sdo["Motor rated torque"].raw, 7056)
        self.assertEqual(sdo[0x60C2][2].raw, -3)

    def test_every_object_of_the_eds_is_there(self):
        count = 0
        for entry in self.node.object_dictionary.values():
            for variable in [entry] if hasattr(entry, "data_type") else entry.values():
                self.node.sdo.upload(variable.index, variable.subindex)
                count += 1
        self.assertGreater(count, 150)

    def test_sdo_both_ways_with_aborts(self):
        sdo = self.node.sdo
        sdo[0x1017].raw = 250
        self.assertEqual(sdo[0x1017].raw, 250)
        sdo.download(0x6085, 0, (5000).to_bytes(4, "little"), force_segment=True)
        self.assertEqual(sdo[0x6085].raw, 5000)
        for code, act in (
            (0x06020000, lambda: sdo.upload(0x5555, 0)),
            (0x06090011, lambda: sdo.upload(0x1018, 9)),
            (0x06010002, lambda: sdo.download(0x6041, 0, b"\0\0")),
            (0x06070012, lambda: sdo.download(0x6040, 0, b"\0\0\0\0")),
            (0x06070013, lambda: sdo.download(0x6040, 0, b"\0")),
            (0x06090031, lambda: sdo.download(0x605A, 0, b"\7\0")),
            (0x08000022, lambda: sdo.download(0x1600, 0, b"\0")),
        ):
            with self.assertRaises(canopen.SdoAbortedError) as caught:
                act()
            self.assertEqual(caught.exception.code, code)

    def test_torque_by_pdo_at_sync(self):
        node = self.node
        self.map_torque()
        node.sdo[0x6060].raw = 10
        self.assertEqual(node.sdo[0x6061].raw, 10)
        node.nmt.state = "OPERATIONAL"
        feedback = []
        node.tpdo[1].add_callback(lambda pdo: feedback.append([v.raw for v in pdo]))
        for controlword in (0x06, 0x07, 0x0F):
            node.rpdo[1][0].raw = controlword
            node.rpdo[1][1].raw = 500
            node.rpdo[1].transmit()
            self.network.sync.transmit()
        self.wait_for(lambda: node.sdo[0x6041].raw & 0x6F == 0x27, "operation enabled")
        self.assertAlmostEqual(self.tell("torque 0"), 0.5 * RATED_NM, places=8)
        self.wait_for(lambda: len(feedback) == 3, "a TPDO each SYNC")

        self.tell("turn 0 -123456")
        node.rpdo[1][1].raw = -250
        node.rpdo[1].transmit()
        time.sleep(0.02)
        self.assertAlmostEqual(self.tell("torque 0"), 0.5 * RATED_NM, places=8, msg="before SYNC")
        self.network.sync.transmit()
        self.wait_for(lambda: len(feedback) == 4, "feedback")
        self.assertEqual(feedback[-1], [-123456, 0, 0])
        self.assertAlmostEqual(self.tell("torque 0"), -0.25 * RATED_NM, places=8)

    def test_its_own_state_machine_enables_and_recovers(self):
        node = self.node
        self.map_torque(status_type=1)  # this state machine waits for a statusword that keeps coming
        node.sdo[0x6060].raw = 10
        node.setup_402_state_machine(read_pdos=False)
        node.nmt.state = "OPERATIONAL"
        self.network.sync.start(0.02)
        node.rpdo[1].start(0.02)
        try:
            self.wait_for(lambda: node.state == "SWITCH ON DISABLED", "the first statusword")
            node.state = "OPERATION ENABLED"
            self.assertEqual(node.state, "OPERATION ENABLED")
            self.tell("emcy 0 2310")
            self.wait_for(lambda: node.state == "FAULT", "fault")
            self.wait_for(lambda: len(node.emcy.active) == 1, "EMCY")
            self.assertEqual(node.emcy.active[0].code, 0x2310)
            self.assertEqual(node.emcy.active[0].register, 0x02)
            self.assertEqual(node.sdo[0x1003][1].raw, 0x2310)
            node.reset_from_fault()
            self.assertEqual(node.state, "OPERATION ENABLED")
            self.assertEqual(node.emcy.active, [])
            node.state = "QUICK STOP ACTIVE"
            node.state = "SWITCH ON DISABLED"
            self.assertEqual(self.tell("torque 0"), 0)
        finally:
            node.rpdo[1].stop()
            self.network.sync.stop()

    def test_heartbeats_and_reboots_are_seen(self):
        node = self.node
        node.sdo[0x1017].raw = 50
        self.assertEqual(node.nmt.wait_for_heartbeat(1), "PRE-OPERATIONAL")
        node.nmt.state = "OPERATIONAL"
        self.wait_for(lambda: node.nmt.wait_for_heartbeat(1) == "OPERATIONAL", "operational")
        seen = self.boot_ups
        self.tell("power 0")
        self.wait_for(lambda: self.boot_ups > seen, "boot-up message")
        self.assertEqual(node.sdo[0x1017].raw, 0)

    def test_store_and_restore_by_the_peers_own_calls(self):
        node = self.node
        node.sdo[0x6085].raw = 7777
        node.store()
        self.reset()
        self.assertEqual(node.sdo[0x6085].raw, 7777)
        node.restore()
        self.reset()
        self.assertEqual(node.sdo[0x6085].raw, 10000)

    def raw(self):
        bus = can.Bus(interface="socketcan", channel="vcan0")
        self.addCleanup(bus.shutdown)
        return bus

    def answer(self, bus, data, remote=False, wait=0.3, identifier=0x601):
        """What node 1's SDO server says to a frame; None when it keeps silent."""
        while bus.recv(0) is not None:
            pass
        data = bytes.fromhex(data)
        bus.send(
            can.Message(
                arbitration_id=identifier, data=data, is_extended_id=False, is_remote_frame=remote, dlc=len(data) or 8
            )
        )
        end = time.monotonic() + wait
        while time.monotonic() < end:
            message = bus.recv(wait)
            if message is not None and message.arbitration_id == 0x581:
                return message.data.hex()
        return None

    def test_strange_sdo_sequences_are_aborted_and_forgotten(self):
        bus = self.raw()
        command, toggle = "01000405", "00000305"
        start, segment, other_segment = "4008100000000000", "6000000000000000", "7000000000000000"
        begun = "4108100005000000"
        for what, steps in {
            "segment without a transfer": [(segment, "80000000" + command)],
            "download segment without a transfer": [("0000000000000000", "80000000" + command)],
            "wrong toggle": [(start, begun), (other_segment, "80081000" + toggle), (segment, "80000000" + command)],
            "toggle that stays": [
                ("2185600004000000", "6085600000000000"),
                ("0088130000000000", "2000000000000000"),
                ("0000000000000000", "80856000" + toggle),
            ],
            "abort in the middle": [(start, begun), ("8008100000000405", None), (segment, "80000000" + command)],
            "abort without a transfer": [("8008100000000405", None)],
            "a new transfer in the middle": [(start, begun), ("4000100000000000", "4300100092010200")],
            "download into an upload": [(start, begun), ("0000000000000000", "80000000" + command)],
            "announced and sent differ": [
                ("2185600004000000", "6085600000000000"),
                ("0B88130000000000", "8085600010000706"),
            ],
            "block upload": [("a008100000000000", "80081000" + command)],
            "block download": [("c608100000000000", "80081000" + command)],
            "specifier 7": [("e000100000000000", "80001000" + command)],
        }.items():
            with self.subTest(what):
                for request, expected in steps:
                    self.assertEqual(self.answer(bus, request, wait=2 if expected else 0.3), expected)
                self.assertEqual(self.answer(bus, "4000100000000000", wait=2), "4300100092010200", "as if nothing was")
        self.assertIsNone(self.answer(bus, "", remote=True), "a remote frame asks nothing")
        self.assertEqual(self.node.sdo[0x6085].raw, 10000, "none of it was written")

    def test_nmt_commands_in_each_state_lead_where_the_standard_says(self):
        node, bus = self.node, self.raw()
        states = {"PRE-OPERATIONAL": 0x80, "OPERATIONAL": 0x01, "STOPPED": 0x02}
        for first, into in states.items():
            for second, command in states.items():
                with self.subTest(first=first, second=second):
                    self.reset()
                    node.sdo[0x1017].raw = 20
                    node.nmt.send_command(into)
                    node.nmt.send_command(command)
                    self.wait_for(lambda: node.nmt.wait_for_heartbeat(2) == second, second)
                    answers = self.answer(bus, "4000100000000000", wait=0.5 if second == "STOPPED" else 2)
                    self.assertEqual(answers is not None, second != "STOPPED", "SDO in this state")
                    for wrong in ("0501", "01", "010100", "0180"):  # no command, short, long, no node
                        self.answer(bus, wrong, identifier=0, wait=0.02)
                    self.assertEqual(node.nmt.wait_for_heartbeat(2), second)
            with self.subTest(first=first, second="resets"):
                for command in (0x81, 0x82):
                    node.nmt.send_command(into)
                    seen = self.boot_ups
                    node.nmt.send_command(command)
                    self.wait_for(lambda: self.boot_ups > seen, "boot-up message")
                    self.assertIsNotNone(self.answer(bus, "4000100000000000", wait=2))

    def test_heartbeats_of_zero_and_node_guarding_are_silence(self):
        node, bus = self.node, self.raw()
        node.sdo[0x1017].raw = 20
        node.nmt.wait_for_heartbeat(2)
        node.sdo[0x1017].raw = 0
        time.sleep(0.1)
        while bus.recv(0) is not None:
            pass
        bus.send(can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True, dlc=1))
        time.sleep(0.2)
        heard = []
        while (message := bus.recv(0)) is not None:
            heard.append(message.arbitration_id)
        self.assertNotIn(0x701, heard, "this drive has heartbeats only, and those are off")

    def test_a_consumer_of_zero_watches_nothing(self):
        node, bus = self.node, self.raw()
        beat = can.Message(arbitration_id=0x70A, data=[5], is_extended_id=False)
        for setting, lost in (((10 << 16) | 0, False), ((0 << 16) | 50, False), ((10 << 16) | 50, True)):
            self.reset()
            node.emcy.log.clear()
            node.sdo[0x1016][1].raw = setting
            bus.send(beat)
            time.sleep(0.4)
            self.assertEqual([e.code for e in node.emcy.log], [0x8130] if lost else [], hex(setting))

    def test_mappings_with_wrong_lengths_and_objects(self):
        sdo = self.node.sdo

        def write(index, sub, value, size):
            sdo.download(index, sub, value.to_bytes(size, "little"))

        write(0x1400, 1, 0x80000201, 4)
        write(0x1600, 0, 0, 1)
        for entry, code in (
            (0x60710020, 0x06040041),  # 32 bits of an object that has 16
            (0x60710008, 0x06040041),
            (0x60710000, 0x06040041),
            (0x60410010, 0x06040041),  # read-only in an RPDO
            (0x60760020, 0x06040041),  # not mappable
            (0x77770010, 0x06020000),
        ):
            with self.assertRaises(canopen.SdoAbortedError, msg=hex(entry)) as caught:
                write(0x1600, 1, entry, 4)
            self.assertEqual(caught.exception.code, code, hex(entry))
        for i, entry in enumerate((0x607A0020, 0x60FF0020, 0x60400010)):  # ten bytes
            write(0x1600, i + 1, entry, 4)
        with self.assertRaises(canopen.SdoAbortedError) as caught:
            write(0x1600, 0, 3, 1)
        self.assertEqual(caught.exception.code, 0x06040042)
        write(0x1600, 0, 2, 1)
        write(0x1400, 1, 0x201, 4)
        for index, sub, value, size in ((0x1600, 0, 0, 1), (0x1400, 1, 0x211, 4)):  # while it is valid
            with self.assertRaises(canopen.SdoAbortedError):
                write(index, sub, value, size)

    def test_node_id_by_store_and_reset(self):
        self.node.sdo[0x2000].raw = 33
        self.node.store()
        self.node.nmt.send_command(0x81)
        moved = self.network.add_node(33, self.node.object_dictionary)
        self.wait_for(lambda: moved.nmt.timestamp is not None, "boot-up of node 33")
        self.assertEqual(moved.sdo[0x1014].raw, 0x80 + 33)
        moved.restore()
        moved.nmt.send_command(0x81)
        self.reset()
        self.assertEqual(self.node.sdo[0x2000].raw, 1)

    def test_a_scan_finds_the_nodes(self):
        self.network.scanner.reset()
        self.network.scanner.search(limit=20)
        self.wait_for(lambda: sorted(self.network.scanner.nodes) == [1, 2], "scan")


if __name__ == "__main__":
    RACK = sys.argv.pop(1)
    unittest.main(verbosity=2)
