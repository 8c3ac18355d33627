// One control cycle from SYNC to torques: drive feedback in, Controller::Step, torques out, and the record of
// all of it. The daemon runs it against the machine's clock and the demo in simulated time; knows nothing of
// threads or LCM. Reversed motors and encoders are corrected here only, and the drive of a pair becomes one
// for each of its tendons.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "tendril/canopen/master.h"
#include "tendril/control/controller.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/rt/cyclic.h"

namespace tendril::daemon {

class ControlCycle {
 public:
  /// Called while answers of drives are outstanding: returns true when frames may wait on the port, false
  /// when none will come until `deadline_ns`. On a real bus this is CanPort::WaitUntil; in simulated time it
  /// lets the drives answer. Must not throw.
  using Wait = std::function<bool(TimeNs deadline_ns)>;

  /// Everything passed in must outlive the cycle. `master` has the drives of `robot` in tendon order; the
  /// controller sees one for every tendon, that of a pair twice.
  ControlCycle(control::Controller& controller, canopen::Master& master, const Clock& clock,
               const RobotParameters& robot, const BusParameters& bus, Wait wait);

  /// SYNC, feedback until complete or bus.feedback_deadline_ns later, Step, torques, then `record` filled.
  /// `command` (kind kNone: nothing new) and `tracker` (valid only when new) become part of the input. No
  /// allocation or lock, and no system call beyond clock, port and `wait`.
  void Run(const rt::CycleStart& start, const Command& command, const TrackerSample& tracker,
           CycleRecord& record) noexcept;

 private:
  control::Controller& controller_;
  canopen::Master& master_;
  const Clock& clock_;
  TimeNs feedback_deadline_ns_;
  std::array<bool, kMaxTendons> motor_reversed_{}, encoder_reversed_{};  // by drive
  struct Side {
    std::size_t drive;
    bool turned;  // a pair's second tendon, which the drive's positive angle pays out
  };
  std::vector<Side> tendons_;
  Wait wait_;
  std::uint64_t deadline_misses_ = 0;
};

}  // namespace tendril::daemon
