#!/usr/bin/env python3
"""What is checked on the booted computer: the package, the service, and what drives and journal say when the daemon is
stopped, killed, frozen. Runs as root on a Debian with systemd; judges by the bus, by dpkg, systemctl and journalctl, not
by the daemon's own word. Knows the programs by their command lines and the drives by CiA 301 and 402."""
import json
import pathlib
import socket
import struct
import subprocess
import sys
import threading
import time

SHARE = pathlib.Path("/share")
NODES = (1, 2, 3)
CONFIG = pathlib.Path("/etc/tendril/tendrild.yaml")
KEPT = CONFIG.with_suffix(".kept")
LATER = "0.1.0+later"  # version of the package upgraded to

# The drives' word for a master that is gone (CiA 301, error 8130), and how long they may take: two lost heartbeats and a
# little, as bus.heartbeat_timeout_ms says, and the emulated drive's own cycle.
HEARTBEAT_LOST = 0x8130
FALL_BACK_S = 0.25 + 0.02


class Failed(Exception):
    pass


def expect(condition, text):
    if not condition:
        raise Failed(text)


def run(*command, check=True, **how):
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, **how)
    if check and done.returncode != 0:
        raise Failed(f"{' '.join(command)}: exit {done.returncode}: {done.stdout[-500:]} {done.stderr[-500:]}")
    return done


def until(seconds, condition, what):
    """Polls until `condition` gives something true, and returns that."""
    end = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > end:
            raise Failed(f"not within {seconds} s: {what}")
        time.sleep(0.2)  # each look costs the outer machine a process or two


def unit(*names, of="tendrild.service"):
    """Properties of a unit, as systemd has them now."""
    shown = run("systemctl", "show", of, *(f"--property={name}" for name in names)).stdout
    values = dict(line.split("=", 1) for line in shown.splitlines())
    return values[names[0]] if len(names) == 1 else [values[name] for name in names]


class Journal:
    """Entries since it was made, with all their fields."""

    def __init__(self):
        run("journalctl", "--sync")
        newest = run("journalctl", "-n", "1", "-o", "json").stdout.splitlines()
        self.cursor = json.loads(newest[-1])["__CURSOR"]

    def entries(self):
        run("journalctl", "--sync")
        # What the daemon said, and what systemd said about it. (With a filter of its own, journalctl leaves out the first.)
        text = run("journalctl", "--after-cursor", self.cursor, "-o", "json").stdout
        every = [json.loads(line) for line in text.splitlines()]
        return [e for e in every if "tendrild.service" in (e.get("_SYSTEMD_UNIT"), e.get("UNIT"))]

    def find(self, text, **fields):
        for entry in self.entries():
            if text in str(entry.get("MESSAGE")) and all(str(entry.get(k)) == str(v) for k, v in fields.items()):
                return entry
        said = "\n  ".join(str(e.get("MESSAGE")) for e in self.entries()[-30:])
        raise Failed(f"the journal does not say '{text}' with {fields}; it says\n  {said}")


class Bus:
    """Listens to vcan0 beside everybody else: emergencies, heartbeats, and when the master last spoke."""

    def __init__(self):
        self.emergencies, self.heartbeats, self.torques = [], [], []
        self.last_master = 0.0
        self.socket = self.open((0x080, 0x780), (0x700, 0x780), (0x200, 0x780))
        threading.Thread(target=self.listen, daemon=True).start()

    @staticmethod
    def open(*filters):
        s = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        s.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"".join(struct.pack("=II", i, m) for i, m in filters))
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        s.bind(("vcan0",))
        return s

    @staticmethod
    def receive(s):
        ident, length, data = struct.unpack("=IB3x8s", s.recv(16))
        return ident, data[:length]

    def listen(self):
        while True:
            ident, data = self.receive(self.socket)
            now, kind, node = time.monotonic(), ident & 0x780, ident & 0x7F
            if kind == 0x080 and node and struct.unpack("<H", data[:2])[0]:
                self.emergencies.append((now, node, struct.unpack("<H", data[:2])[0]))
            elif kind == 0x080:
                self.last_master = now  # SYNC
            elif kind == 0x700 and node in NODES:
                self.heartbeats.append((now, node, data[0]))
            elif kind == 0x200:
                self.torques.append((now, node, *struct.unpack("<Hh", data[:4])))

    def read(self, node, index, form):
        """An object of a drive by SDO (expedited), as any service tool reads it."""
        with self.open((0x580 + node, 0x7FF)) as s:
            s.settimeout(2)
            s.send(struct.pack("=IB3x8s", 0x600 + node, 8, struct.pack("<BHB4x", 0x40, index, 0)))
            while True:
                _, data = self.receive(s)
                if data[0] & 0xE0 == 0x40 and data[1:4] == struct.pack("<HB", index, 0):
                    return struct.unpack("<" + form, data[4:4 + struct.calcsize(form)])[0]

    def positions(self):
        """Increments of each motor, from the drives' cyclic feedback."""
        seen = {}
        with self.open((0x180, 0x780)) as s:
            s.settimeout(2)
            while len(seen) < len(NODES):
                ident, data = self.receive(s)
                if len(data) == 8:
                    seen[ident & 0x7F] = struct.unpack("<i", data[:4])[0]
        return [seen[node] for node in NODES]

    def powered(self, master_left=False):
        """Nodes whose power stage is on. A master that left in good order has stopped the nodes' communication (NMT):
        then they are asked for it again."""
        if master_left:
            self.socket.send(struct.pack("=IB3x8s", 0, 2, bytes((0x80, 0))))
            time.sleep(0.01)
        return [node for node in NODES if self.read(node, 0x6041, "H") & 0x6F in (0x23, 0x27, 0x07)]

    def fell_back(self, since):
        """How long after the master's last SYNC the last drive gave it up."""
        def all_of_them():
            told = {node: at for at, node, code in self.emergencies if at >= since and code == HEARTBEAT_LOST}
            return max(told.values()) if len(told) == len(NODES) else None
        return until(2, all_of_them, "every drive reports its heartbeat consumer") - self.last_master


bus = None


def status():
    done = run("tendril", "status", "--json", check=False)
    return json.loads(done.stdout) if done.returncode == 0 else {}


def mode_is(mode, seconds=10):
    until(seconds, lambda: status().get("mode") == mode, f"mode {mode} (it is {status().get('mode')})")


def start_running_bent():
    run("tendril", "send", "arm")
    mode_is("running")
    before = bus.positions()
    run("tendril", "send", "tip", "0.01", "0", "0.0589")
    time.sleep(1.5)
    after = bus.positions()
    return [b - a for a, b in zip(before, after)]


# ---- the steps, in the order in which a robot computer sees them ----------------------------------------------------


def the_computer_is_up():
    state = run("systemctl", "is-system-running", "--wait", check=False).stdout.strip()
    # "starting" as this test is itself part of the start-up.
    failed = run("systemctl", "--failed", "--plain", "--no-legend").stdout
    expect(failed == "", f"{state}; failed units before the test: {failed}")


def the_package_went_into_the_image_without_enabling_anything():
    expect((SHARE / "enabled_by_itself").read_text().strip() == "disabled", "enabled by the installation")
    expect(run("id", "-nG", "tendril").stdout.split() == ["tendril"], "user tendril with group tendril")
    expect(run("dpkg-query", "-W", "-f=${Conffiles}", "tendril").stdout.strip() == "",
           "no conffiles: the configuration is the operator's")
    verified = run("systemd-analyze", "verify", "tendrild.service", check=False)
    expect("tendrild.service" not in verified.stderr, f"systemd-analyze verify: {verified.stderr}")
    for program in ("tendril", "tendrild", "tendril-plant"):
        expect("0.1.0" in run(program, "--version").stdout, f"{program} --version")
    run("tendril", "config", "check", str(CONFIG))


def enabled_it_waits_for_what_is_not_there_yet():
    """No CAN interface, no network: for long enough that five starts would have been used up."""
    time.sleep(15)
    expect(unit("ActiveState", "NRestarts") == ["active", "0"], f"{unit('ActiveState', 'NRestarts')}")
    expect("waiting: CAN interface 'vcan0' does not exist" in unit("StatusText"), unit("StatusText"))
    expect("224.0.0.0/4 dev lo" in run("ip", "route", "show").stdout, "a route for LCM")
    expect(status() == {}, "nobody answers yet")


def the_interface_appears_and_it_goes_on():
    run("ip", "link", "add", "vcan0", "type", "vcan")
    until(5, lambda: "waiting: CAN interface 'vcan0' is down" in unit("StatusText"), "it waits for a link that is up")
    run("ip", "link", "set", "vcan0", "up")
    run("systemd-run", "--unit=plant", "tendril-plant", "--robot", str(CONFIG.parent / "robots/rig_60mm.yaml"),
        "--can", "vcan0")
    global bus
    bus = Bus()
    mode_is("configured")
    time.sleep(3)
    expect(unit("NRestarts") == "0" and status().get("mode") == "configured", "one start, and no watchdog's bite")


def the_can_snippets_fit_systemd():
    """The link file, put where the guide says, gives a can0 its queue (the bit rate needs hardware)."""
    folder = pathlib.Path("/etc/systemd/network")
    folder.mkdir(exist_ok=True)
    for snippet in pathlib.Path("/usr/share/tendril/networkd").iterdir():
        (folder / snippet.name).write_text(snippet.read_text())
    run("udevadm", "control", "--reload")
    run("ip", "link", "add", "can0", "type", "vcan")
    run("udevadm", "settle")
    length = pathlib.Path("/sys/class/net/can0/tx_queue_len").read_text().strip()
    run("ip", "link", "del", "can0")
    expect(length == "38", f"tx_queue_len of can0 is {length}")


def the_unit_becomes_active():
    run("systemctl", "stop", "tendrild.service")
    journal = Journal()
    run("systemctl", "start", "tendrild.service")
    expect(unit("ActiveState", "SubState", "Type") == ["active", "running", "notify"], "active after its READY=1")
    mode_is("configured")
    pid = unit("MainPID")
    user = pathlib.Path(f"/proc/{pid}").owner()
    expect(user == "tendril", f"it runs as '{user}'")
    policy = {run("chrt", "-p", task.name).stdout.split("policy: ")[1].split()[0]
              for task in pathlib.Path(f"/proc/{pid}/task").iterdir()}
    expect("SCHED_FIFO" in policy, f"a thread with SCHED_FIFO (there are {policy})")
    locked = next(line for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines() if "VmLck" in line)
    expect(int(locked.split()[1]) > 0, f"locked memory: {locked}")
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    expect("Seccomp:\t2" in status, "its system calls are filtered")
    adjusted = pathlib.Path(f"/proc/{pid}/oom_score_adj").read_text().strip()
    expect(adjusted == "-900", f"when memory runs out others go first: {adjusted}")
    until(2, lambda: "configured" in unit("StatusText"), "systemctl status tells the mode")
    entry = journal.find("disconnected -> configured", TENDRIL_STATUS=0, TENDRIL_SOURCE="controller", PRIORITY=6)
    expect(entry["_SYSTEMD_UNIT"] == "tendrild.service" and entry["SYSLOG_IDENTIFIER"] == "tendrild", "its identity")
    warnings = [e["MESSAGE"] for e in journal.entries() if int(e["PRIORITY"]) <= 4 and e.get("_COMM") == "tendrild"]
    expect(len(warnings) == 1 and "commissioning is not required" in warnings[0],
           f"nothing to warn of but commissioning, which this simulation does without: {warnings}")
    # (From here on it may warn of us: we ask its drives, too.)
    expect(not bus.powered(), "no drive is on before anybody armed")


def send_moves_the_plant():
    moved = start_running_bent()
    expect(moved[0] > 100 and max(abs(m) for m in moved[1:]) > 20,
           f"motors turn, the first one pulls: {moved} increments")
    tip = status()["tip_estimate_W_m"]
    expect(abs(tip[0] - 0.01) < 0.003, f"the tip is at {tip}, told 0.01 0 0.0589")
    expect(bus.powered() == list(NODES), "the drives are on")


def a_hangup_is_refused_with_the_reason():
    journal, pid = Journal(), unit("MainPID")
    run("systemctl", "kill", "--signal=HUP", "--kill-whom=main", "tendrild.service")
    time.sleep(0.5)
    expect(unit("MainPID") == pid and status()["mode"] == "running", "it goes on as it was")
    journal.find("SIGHUP refused", PRIORITY=4, _PID=pid)
    journal = Journal()
    refused = run("systemctl", "reload", "tendrild.service", check=False)
    expect(refused.returncode != 0, "systemctl reload is refused")
    journal.find("SIGHUP refused", PRIORITY=4, _PID=pid)
    expect(unit("MainPID") == pid and status()["mode"] == "running", "it goes on after that as well")


def an_upgrade_leaves_the_robot_alone():
    pid = unit("MainPID")
    told = run("dpkg", "-i", str(SHARE / "later.deb")).stdout
    expect("goes on as version" in told, f"the operator is told: {told}")
    expect(run("dpkg-query", "-W", "-f=${Version}", "tendril").stdout == LATER, "the new version is installed")
    expect(unit("MainPID", "UnitFileState") == [pid, "enabled"] and status()["mode"] == "running",
           "the daemon goes on, and stays enabled")
    expect("vcan0" in CONFIG.read_text(), "the operator's file is kept")


def stop_is_a_safe_stop():
    journal = Journal()
    began, emergencies = time.monotonic(), len(bus.emergencies)
    bus.torques.clear()
    run("systemctl", "stop", "tendrild.service")
    took = time.monotonic() - began
    expect(took < 2, f"it took {took:.2f} s")
    expect(unit("ActiveState", "Result", "ExecMainStatus") == ["inactive", "success", "0"], "a clean end")
    expect(len(bus.emergencies) == emergencies, f"no emergencies: {bus.emergencies[emergencies:]}")
    on = bus.powered(master_left=True)
    expect(not on, f"drives still on: {on}")
    # Torque of the tendon that was pulled: down by a ramp, before the drive is switched off.
    on = [(at, torque) for at, node, control, torque in bus.torques if node == 1 and control & 0x0F == 0x0F]
    steps = [abs(b[1] - a[1]) for a, b in zip(on, on[1:])]
    expect(on[-1][1] < 0.5 * on[0][1] and max(steps) <= 0.1 * on[0][1],
           f"torque from {on[0][1]} to {on[-1][1]} per mille in {len(on)} cycles, steps up to {max(steps)}")
    journal.find("stopping: disarming", TENDRIL_SOURCE="daemon")
    journal.find("running -> ", TENDRIL_SOURCE="controller")
    journal.find("stopped", TENDRIL_SOURCE="daemon")
    return f"{took:.2f} s, torque {on[0][1]} -> {on[-1][1]} per mille over {on[-1][0] - on[0][0]:.2f} s"


def restarts_disarmed(journal, pid):
    """The new daemon finds drives that gave up their master, says so, and waits for the operator."""
    until(20, lambda: unit("ActiveState") == "active" and unit("MainPID") not in ("0", pid), "systemd restarts it")
    journal.find("Scheduled restart job", SYSLOG_IDENTIFIER="systemd")
    time.sleep(1.2)
    told = journal.find("error 0x8130 heartbeat lost: clear", _PID=unit("MainPID"), PRIORITY=3, TENDRIL_SOURCE="bus")
    expect(int(told["TENDRIL_STATUS"]) >= 400, f"its status is a fault's: {told['TENDRIL_STATUS']}")
    expect(not bus.powered(), "nothing resumes by itself")
    refused = run("tendril", "send", "arm", check=False)
    expect(refused.returncode == 1 and not bus.powered(), "arm is refused")
    expect("316 a drive was found in fault" in refused.stderr and "then clear" in refused.stderr,
           f"arm tells what to do: {refused.stderr}")
    run("tendril", "send", "clear")
    mode_is("configured")
    expect(not bus.powered(), "nor after clear")


def killed_the_drives_fall_back_by_themselves():
    run("systemctl", "start", "tendrild.service")
    mode_is("configured")
    start_running_bent()
    journal, pid, began = Journal(), unit("MainPID"), time.monotonic()
    run("systemctl", "kill", "--signal=KILL", "--kill-whom=main", "tendrild.service")
    took = bus.fell_back(began)
    expect(took < FALL_BACK_S, f"the drives took {took:.3f} s")
    expect(not bus.powered(), f"still on: {bus.powered()}")
    # What a drive reports scatters by 0.3 per mille rms and is rounded: one is no torque, two is five times that.
    left = [bus.read(node, 0x6077, "h") for node in NODES]
    expect(all(abs(torque) <= 1 for torque in left), f"torque left [per mille]: {left}")
    expect(unit("SubState") == "auto-restart", "all that before systemd started it again")
    journal.find("Main process exited, code=killed, status=9/KILL", EXIT_CODE="killed", EXIT_STATUS=9)
    restarts_disarmed(journal, pid)
    return f"{1e3 * took:.0f} ms from the last SYNC to the last drive's error 8130"


def frozen_it_is_ended_by_the_watchdog():
    run("tendril", "home")  # its drives have let go: tendons may hang
    start_running_bent()
    journal, pid, began = Journal(), unit("MainPID"), time.monotonic()
    run("systemctl", "kill", "--signal=STOP", "--kill-whom=main", "tendrild.service")
    took = bus.fell_back(began)
    expect(took < FALL_BACK_S, f"the drives took {took:.3f} s")
    expect(unit("MainPID") == pid, "the drives are faster than the watchdog")
    expect(not bus.powered(), f"still on: {bus.powered()}")
    until(6, lambda: unit("MainPID") != pid, "the watchdog ends it")
    ended = time.monotonic() - began
    journal.find("Watchdog timeout (limit 2s)!", SYSLOG_IDENTIFIER="systemd")
    journal.find("Failed with result 'watchdog'", UNIT_RESULT="watchdog")
    restarts_disarmed(journal, pid)
    return f"drives after {1e3 * took:.0f} ms, watchdog after {ended:.1f} s"


def no_configuration_no_start():
    run("systemctl", "stop", "tendrild.service")
    journal = Journal()
    CONFIG.rename(KEPT)
    run("systemctl", "start", "tendrild.service")
    expect(unit("ActiveState", "ConditionResult") == ["inactive", "no"], "the condition keeps it from starting")
    journal.find("ConditionPathExists=/etc/tendril/tendrild.yaml")


def a_bad_configuration_meets_the_start_limit():
    journal = Journal()
    CONFIG.write_text("robot: nowhere.yaml\n")
    run("systemctl", "reset-failed", "tendrild.service")  # none of the last minute's starts counts
    run("systemctl", "start", "tendrild.service", check=False)
    until(60, lambda: unit("ActiveState", "Result") == ["failed", "exit-code"], "the start limit")
    journal.find("Start request repeated too quickly")
    starts = [e for e in journal.entries() if str(e.get("MESSAGE")).startswith("tendrild: ")]
    expect(len(starts) == 5, f"{len(starts)} starts instead of five")
    expect(all(e["PRIORITY"] == "3" and str(CONFIG) in e["MESSAGE"] for e in starts),
           f"each start tells the file, as an error: {starts[0].get('PRIORITY')} {starts[0].get('MESSAGE')}")
    time.sleep(5)
    expect(unit("ActiveState") == "failed", "it stays down")
    expect(not bus.powered(master_left=True), "the drives stay off")
    run("systemctl", "reset-failed", "tendrild.service")
    KEPT.rename(CONFIG)


def removal_stops_and_keeps_what_is_the_operators():
    run("systemctl", "start", "tendrild.service")
    mode_is("configured")
    start_running_bent()
    emergencies = len(bus.emergencies)
    told = run("dpkg", "-r", "tendril")
    expect(len(bus.emergencies) == emergencies and not bus.powered(master_left=True),
           f"a safe stop comes first: {bus.emergencies[emergencies:]} {told.stderr}")
    expect(not pathlib.Path("/usr/bin/tendrild").exists(), "the programs are gone")
    expect(unit("LoadState") == "not-found", "the unit is gone")
    expect(CONFIG.exists() and pathlib.Path("/var/lib/tendrild").is_dir(), "configuration and black boxes stay")


def reinstalled_it_is_as_before():
    run("dpkg", "-i", str(SHARE / "tendril.deb"))
    expect(unit("ActiveState", "UnitFileState") == ["inactive", "enabled"], "enabled as it was, not started")
    run("systemctl", "start", "tendrild.service")
    expect(unit("ActiveState") == "active", "and it starts")
    run("systemctl", "stop", "tendrild.service")


def purging_leaves_nothing_of_ours():
    run("dpkg", "-P", "tendril")
    expect(not pathlib.Path("/var/lib/tendrild").exists(), "/var/lib/tendrild")
    left = list(pathlib.Path("/etc/systemd").rglob("tendrild*"))
    expect(not left, f"left: {left}")
    expect(CONFIG.exists(), "what the operator wrote is not ours to delete")
    expect(run("dpkg", "--audit").stdout == "", "dpkg --audit")


STEPS = (
    the_computer_is_up,
    the_package_went_into_the_image_without_enabling_anything,
    enabled_it_waits_for_what_is_not_there_yet,
    the_interface_appears_and_it_goes_on,
    the_can_snippets_fit_systemd,
    the_unit_becomes_active,
    send_moves_the_plant,
    a_hangup_is_refused_with_the_reason,
    an_upgrade_leaves_the_robot_alone,
    stop_is_a_safe_stop,
    killed_the_drives_fall_back_by_themselves,
    frozen_it_is_ended_by_the_watchdog,
    no_configuration_no_start,
    a_bad_configuration_meets_the_start_limit,
    removal_stops_and_keeps_what_is_the_operators,
    reinstalled_it_is_as_before,
    purging_leaves_nothing_of_ours,
)


def main():
    report = (SHARE / "report").open("w", buffering=1)
    journal = (SHARE / "journal").open("w")
    subprocess.Popen(("journalctl", "--no-pager", "--follow", "--lines=all", "-o", "short-monotonic"), stdout=journal)
    time.sleep(0.1)  # from the computer's first rest on, its time does not depend on how busy the outer machine is
    for step in STEPS:
        began = time.monotonic()
        try:
            detail = step()
        except Exception as problem:  # whatever it is, the report must say so
            report.write(f"FAILED {step.__name__}: {type(problem).__name__}: {problem}\n")
            break
        report.write(f"ok {step.__name__} ({time.monotonic() - began:.1f} s){': ' + detail if detail else ''}\n")
    else:
        report.write(f"all {len(STEPS)} steps passed\n")
    run("journalctl", "--sync")
    time.sleep(0.2)
    subprocess.run(("systemctl", "poweroff", "--force", "--force"), check=False)


if __name__ == "__main__":
    sys.exit(main())
