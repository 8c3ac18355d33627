// One drive as the master sees it: its boot, its CiA 402 state, its faults, its PDOs.
// Passive: frames and time come in by calls, frames to send are asked for. Knows no other node.
#pragma once

#include <array>
#include <vector>

#include "answer_watch.h"
#include "boot_script.h"
#include "event_ring.h"
#include "reply_watch.h"
#include "tendril/can/can_port.h"
#include "tendril/canopen/cia402.h"
#include "tendril/canopen/emcy.h"
#include "tendril/canopen/master.h"
#include "tendril/canopen/pdo.h"
#include "tendril/canopen/sdo.h"

namespace tendril::canopen {

class Node {
 public:
  Node(const BusParameters& bus, const DriveSetup& drive, EventRing& events);

  int id() const noexcept { return id_; }
  const DriveFeedback& feedback() const noexcept { return feedback_; }
  /// SYNC is of use: NMT start was sent, or a restarted drive shows by its answer that it is not alone.
  bool started() const noexcept {
    return phase_ == Phase::kReady || (phase_ == Phase::kScript && started_) || after_boot_up_ > 0;
  }
  bool ready() const noexcept { return phase_ == Phase::kReady; }
  /// 0x1018:04; 0 until it was read once.
  std::uint32_t serial() const noexcept { return serial_; }
  /// Ready, and the feedback TPDO of this cycle is in.
  bool answered() const noexcept { return ready() && feedback_.age_cycles == 0; }
  bool powered() const noexcept { return machine() == DriveMachine::kOperationEnabled; }

  // ---- orders -----------------------------------------------------------------------------------

  /// Boots from NMT reset communication; afterwards resets the drive's fault if told to.
  void Boot(TimeNs now_ns, bool reset_fault) noexcept;
  /// The operator's clear: fault reset, or a new boot where the node was lost.
  void ClearFault(TimeNs now_ns) noexcept;
  /// The bus went away: everything known is void.
  void OnBusDown(TimeNs now_ns) noexcept;
  /// ... and came back: nodes that were lost boot now, and stay disabled until told otherwise.
  void OnBusUp(TimeNs now_ns) noexcept;

  // ---- time -------------------------------------------------------------------------------------

  /// A new cycle begins: ages the feedback, notices time-outs.
  void BeginCycle(TimeNs now_ns) noexcept;
  /// A SYNC is on the bus, by whomever: started drives answer it.
  void OnSync() noexcept { answers_.OnSync(); }

  // ---- frames in --------------------------------------------------------------------------------

  /// PDOs: false when the frame's length is not that of the mapping; then nothing was taken of it.
  bool OnFeedback(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  bool OnStatus(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  void OnSdo(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  /// Somebody else's SDO request to this drive.
  void OnForeignSdoRequest(const can::CanFrame& frame) noexcept { replies_.OnRequest(frame); }
  void OnEmcy(const EmcyMessage& emcy, TimeNs now_ns) noexcept;
  void OnHeartbeat(NmtState state, TimeNs now_ns) noexcept;

  // ---- frames out -------------------------------------------------------------------------------

  /// NMT command or SDO request that waits; nullptr when none does.
  const can::CanFrame* pending() const noexcept;
  void PendingSent(TimeNs now_ns) noexcept;
  /// The RPDO of this cycle; false when the node gets none.
  bool MakeRpdo(TimeNs now_ns, DriveRequest request, std::int16_t torque_permille,
                can::CanFrame* frame) noexcept;

  /// Lets the drive forget the master's heartbeat, so that the master may go; true when done or not possible.
  bool Release() noexcept;

 private:
  enum class Phase : std::uint8_t { kIdle, kWaitBootUp, kScript, kReady, kFailed, kLost };
  enum class Transfer : std::uint8_t { kNone, kProbe, kRead, kWrite, kReadBack, kStatusword, kRelease };
  enum class Reset : std::uint8_t { kNone, kLow, kHigh };

  DriveMachine machine() const noexcept { return DecodeStatusword(feedback_.statusword); }
  const BootAction& action() const noexcept { return script_[at_]; }

  void BeginScript(TimeNs now_ns) noexcept;
  void BeginAction(TimeNs now_ns) noexcept;
  void NextAction(TimeNs now_ns) noexcept;
  void FinishBoot(TimeNs now_ns) noexcept;
  void Read(ObjectAddress address, Transfer transfer) noexcept;
  void WriteObject(ObjectAddress address, std::int64_t value) noexcept;
  void OnTransferEnd(TimeNs now_ns) noexcept;
  void OnTransferFailed(TimeNs now_ns) noexcept;
  void OnRead(std::int64_t value, TimeNs now_ns) noexcept;
  void OnReadBack(std::int64_t value, TimeNs now_ns) noexcept;
  void OnStatusword(std::uint16_t statusword, TimeNs now_ns) noexcept;
  void QueueNmt(NmtCommand command) noexcept;
  void RefreshStatusword(TimeNs now_ns) noexcept;
  std::uint16_t ControlwordOfReset(TimeNs now_ns) noexcept;
  void CheckProgress(TimeNs now_ns) noexcept;
  void Latch(TimeNs now_ns) noexcept;
  void UpdateState() noexcept;
  void Fail(DriveState state) noexcept;
  void CheckReplies(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  void FailTwice(TimeNs now_ns) noexcept;
  void OnAnswerAfterBootUp(TimeNs now_ns) noexcept;
  void Lose(TimeNs now_ns) noexcept;
  /// One event, its text led by "node N: ".
  [[gnu::format(printf, 4, 5)]] void Report(TimeNs now_ns, Status status, const char* format, ...) noexcept;

  const int id_;
  const std::vector<BootAction> script_;
  const std::vector<std::uint32_t> product_codes_;
  const TimeNs cycle_ns_, sdo_timeout_ns_, boot_timeout_ns_, heartbeat_timeout_ns_;
  EventRing& events_;

  Phase phase_ = Phase::kIdle;
  DriveFeedback feedback_;
  SdoClient sdo_;
  Transfer transfer_ = Transfer::kNone;
  can::CanFrame nmt_frame_;
  bool nmt_waits_ = false;

  // boot
  std::size_t at_ = 0;        // action of the script
  int tries_ = 0;             // of the SDO transfer under way
  std::int64_t written_ = 0;  // value that a read-back must show
  bool started_ = false;      // NMT start has left
  bool ever_ready_ = false;   // since the last Boot by order
  bool reset_after_boot_ = false;
  TimeNs boot_deadline_ns_ = 0, probe_ns_ = 0, started_ns_ = 0;
  std::uint32_t product_code_ = 0, serial_ = 0;

  // running
  bool heartbeat_watched_ = false;
  TimeNs heartbeat_deadline_ns_ = 0;
  bool latched_ = false;     // a fault that only the operator clears
  bool may_enable_ = false;  // a disable request was seen since the boot or the last fault
  bool holds_ = false;       // was enabled by us and shall stay so
  bool off_first_ = false;   // told to disable, and not seen disabled yet
  bool walking_ = false;     // on the way to operation enabled
  bool stops_ = false;       // lost, and stopped by NMT again and again
  AnswerWatch answers_;
  ReplyWatch replies_;
  int after_boot_up_ = 0;  // answers still to be seen of a drive said to have restarted; 0: none is watched
  TimeNs walk_deadline_ns_ = 0, stop_again_ns_ = 0, disable_deadline_ns_ = 0, refresh_ns_ = 0;
  Reset reset_ = Reset::kNone;
  bool rebooted_for_reset_ = false;
  TimeNs reset_deadline_ns_ = 0;
  bool released_ = false;
};

}  // namespace tendril::canopen
