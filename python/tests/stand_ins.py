"""A daemon and a guard for tests of the dashboard: they record what they are told, and nothing moves."""

from __future__ import annotations

import numpy as np

import tendril
from tendril.messages import state_t

from conftest import SOURCE


def a_state(mode=state_t.MODE_RUNNING, cycle=1, **changed):
    """A state at rest, upright."""
    message = state_t()
    values = {name: getattr(message, name) for name in tendril.State.__dataclass_fields__}
    nan3 = np.full(3, np.nan)
    values |= dict(mode=mode, cycle=cycle, utime=cycle, mode_text="running" if mode == 4 else f"mode {mode}",
                   status_text="ok", reported=np.array([], int), target_tip_W_m=nan3,
                   tip_desired_W_m=np.array([0, 0, 0.06]), tip_estimate_W_m=np.array([1e-4, 0, 0.06]),
                   bending_desired_rad=np.zeros(2), bending_estimate_rad=np.zeros(2),
                   tension_desired_base_N=np.full(3, 0.3), tension_base_estimate_N=np.array([0.3, 7.9, np.nan]),
                   tension_measured_N=np.array([0.3, 10.5, np.nan]))
    return tendril.State(**(values | changed))


class Daemon:
    """Stands in for `tendril.Client`: takes commands as a gate would, and is in the mode that they ask for at once.

    `sent`: every command: its name, or of a target kind, value, rate and validity [s]. `heard`: False: nobody answers.
    `changed`: fields of the next states. `news`: the events to come.
    """

    def __init__(self, rig, mode=state_t.MODE_CONFIGURED):
        self.rig, self.mode, self.cycle, self.sent, self.heard = rig, mode, 0, [], True
        self.changed, self.news = {}, []
        self._file = tendril.load_daemon(SOURCE / "config" / "tendrild.yaml")

    def state(self, timeout=0.0):
        if not self.heard:
            raise tendril.DaemonError("no daemon answers")
        self.cycle += 1
        return a_state(self.mode, self.cycle, **self.changed)

    def events(self):
        news, self.news = self.news, []
        return news

    def statistics(self):
        return None

    def robot(self, timeout=0.0):
        return self.rig

    def daemon(self, timeout=0.0):
        return self._file

    def _mode(self, name, mode):
        self.sent.append(name)
        self.mode = mode if self.heard else self.mode
        return ""

    def arm(self, timeout=0.0):
        return self._mode("arm", state_t.MODE_RUNNING)

    def disarm(self, timeout=0.0):
        return self._mode("disarm", state_t.MODE_CONFIGURED)

    def hold(self, timeout=0.0):
        return self._mode("hold", state_t.MODE_HOLD)

    def clear(self, timeout=0.0):
        return self._mode("clear", state_t.MODE_DISCONNECTED)

    def _target(self, kind, value, rate, valid_for):
        self.sent.append((kind, np.array(value), None if rate is None else np.array(rate), valid_for))
        return ""

    def send_tip(self, tip, velocity=None, *, valid_for=1.0, timeout=0.0):
        return self._target("tip", tip, velocity, valid_for)

    def send_bending(self, bending, rate=None, *, valid_for=1.0, timeout=0.0):
        return self._target("bend", bending, rate, valid_for)

    @property
    def targets(self):
        return [words for words in self.sent if not isinstance(words, str)]


class Guard:
    """Stands in for the dashboard's guard: it is there, or it does not start."""

    def __init__(self, there=True):
        self.there, self.told, self.left = there, [], None

    def ready(self):
        return self.there

    def tell(self, ours, now):
        self.told.append(ours)
        return self.there

    def leave(self, in_order):
        self.left = in_order
