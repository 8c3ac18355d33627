// The daemon's real-time thread: a control cycle on each deadline, commands in, records and events out by the
// hand-over. Knows nothing of LCM, logs and systemd.
#pragma once

#include <cstdint>
#include <future>
#include <string>
#include <vector>

#include "handover.h"
#include "tendril/can/can_port.h"
#include "tendril/canopen/master.h"
#include "tendril/control/controller.h"
#include "tendril/core/clock.h"
#include "tendril/daemon/black_box.h"
#include "tendril/daemon/control_cycle.h"
#include "tendril/daemon/daemon.h"
#include "tendril/rt/cyclic.h"
#include "tendril/rt/usage.h"

namespace tendril::daemon {

class RealtimeSide {
 public:
  /// All arguments must outlive it.
  RealtimeSide(const DaemonOptions& options, can::CanPort& port, rt::Timebase& time,
               const std::vector<canopen::DriveSetup>& setups, Handover& handover);

  const control::Controller& controller() const { return controller_; }
  /// Adds all cycles from now on; before Run.
  void RecordIn(BlackBox& black_box) { black_box_ = &black_box; }

  /// The thread's whole life: until the drives are disabled after a stop request, or no longer answer.
  /// `ready` gets what is missing of the real-time rights; when they are required, it ends there.
  void Run(std::promise<std::string>& ready);

 private:
  enum class Phase { kRunning, kDisarming, kShutdown };

  bool Tick(const rt::CycleStart& start);
  bool ShutDown(const rt::CycleStart& start, TimeNs now_ns);
  void HandOver(const rt::CycleStart& start);
  Command NextCommand(TimeNs now_ns);
  void DropOvertaken(Command& command);
  bool CommandThreadStalled();
  TrackerSample NextTrackerSample();
  bool AllDisabled() const;
  void ForwardEvents();

  const DaemonOptions& options_;
  rt::Timebase& time_;
  const Clock& clock_;
  const MonotonicClock machine_;  // for the other thread, however fast the robot's time passes
  can::CanPort& port_;
  Handover& handover_;
  canopen::Master master_;
  control::Controller controller_;
  ControlCycle cycle_;
  BlackBox* black_box_ = nullptr;

  Phase phase_ = Phase::kRunning;
  TimeNs stop_ns_ = 0;
  bool disarm_pending_ = false, left_alone_ = false;
  std::uint32_t last_sequence_ = 0;
  rt::UsageMeter usage_;
  Published published_;
};

}  // namespace tendril::daemon
