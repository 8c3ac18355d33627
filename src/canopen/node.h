// The master's view of one drive: its boot, CiA 402 state, faults and PDOs. Passive: frames and time are
// passed in, frames to send are fetched. Knows no other node.
#pragma once

#include <array>
#include <limits>
#include <vector>

#include "answer_watch.h"
#include "event_ring.h"
#include "reply_watch.h"
#include "tendril/can/can_port.h"
#include "tendril/canopen/cia402.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/canopen/emcy.h"
#include "tendril/canopen/master.h"
#include "tendril/canopen/pdo.h"
#include "tendril/canopen/sdo.h"

namespace tendril::canopen {

class Node {
 public:
  Node(const BusParameters& bus, const DriveSetup& drive, EventRing& events);

  int id() const noexcept { return id_; }
  const DrivePdos& pdos() const noexcept { return profile_->pdos; }
  const DriveFeedback& feedback() const noexcept { return feedback_; }
  /// The drive answers SYNC: NMT start was sent, or a restarted drive is checked for a duplicate id.
  bool started() const noexcept {
    return phase_ == Phase::kReady || (phase_ == Phase::kScript && started_) || after_boot_up_ > 0;
  }
  bool ready() const noexcept { return phase_ == Phase::kReady; }
  /// 0x1018:04; 0 until read.
  std::uint32_t serial() const noexcept { return serial_; }
  /// Ready, and the feedback TPDO of this cycle is in.
  bool answered() const noexcept { return ready() && feedback_.age_cycles == 0; }
  bool powered() const noexcept { return machine() == DriveMachine::kOperationEnabled; }

  // ---- orders -----------------------------------------------------------------------------------

  /// Boots from NMT reset communication; then resets the drive's fault if requested.
  void Boot(TimeNs now_ns, bool reset_fault) noexcept;
  /// The operator's clear: fault reset, or a new boot where the node was lost.
  void ClearFault(TimeNs now_ns) noexcept;
  /// The bus went down: all known state becomes invalid.
  void OnBusDown(TimeNs now_ns) noexcept;
  /// ... and came back: lost nodes boot now, and stay disabled until requested otherwise.
  void OnBusUp(TimeNs now_ns) noexcept;

  // ---- time -------------------------------------------------------------------------------------

  /// Begins a cycle: ages the feedback, checks time-outs.
  void BeginCycle(TimeNs now_ns) noexcept;
  /// A SYNC is on the bus, from any sender: started drives answer it.
  void OnSync() noexcept { answers_.OnSync(); }

  // ---- frames in --------------------------------------------------------------------------------

  /// PDOs: false when the frame's length is not that of the mapping; the frame is then ignored.
  bool OnFeedback(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  bool OnStatus(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  void OnSdo(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  /// Another client's SDO request to this drive.
  void OnForeignSdoRequest(const can::CanFrame& frame) noexcept { replies_.OnRequest(frame); }
  void OnEmcy(const EmcyMessage& emcy, TimeNs now_ns) noexcept;
  void OnHeartbeat(NmtState state, TimeNs now_ns) noexcept;

  // ---- frames out -------------------------------------------------------------------------------

  /// Pending NMT command or SDO request; nullptr when there is none.
  const can::CanFrame* pending() const noexcept;
  void PendingSent(TimeNs now_ns) noexcept;
  /// The RPDO of this cycle; false when the node gets none.
  bool MakeRpdo(TimeNs now_ns, DriveRequest request, std::int16_t torque_permille,
                can::CanFrame* frame) noexcept;

  /// Ends the drive's monitoring of the master's heartbeat, so that the master may stop; true when done or
  /// not possible.
  bool Release() noexcept;

 private:
  enum class Phase : std::uint8_t { kIdle, kWaitBootUp, kScript, kReady, kFailed, kLost };
  enum class Transfer : std::uint8_t { kNone, kProbe, kRead, kWrite, kReadBack, kStatusword, kRelease };
  enum class Reset : std::uint8_t { kNone, kLow, kHigh };

  static constexpr TimeNs kFaultReset_ns = 1000 * kNsPerMs;
  // A lost statusword TPDO is replaced by a read after this.
  static constexpr TimeNs kStatusRefresh_ns = 200 * kNsPerMs;
  static constexpr std::uint16_t kNeverHeard = std::numeric_limits<std::uint16_t>::max();

  /// Places of the values in the drive's PDOs.
  struct Slots {
    explicit Slots(const DriveProfile& profile);
    std::size_t controlword, target_torque, position, torque, analog, statusword;
  };

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
  void ReportMismatch(std::int64_t value, TimeNs now_ns) noexcept;
  void OnReadBack(std::int64_t value, TimeNs now_ns) noexcept;
  static DriveState MismatchOf(ObjectAddress address) noexcept;
  int WidthOf(ObjectAddress address) const noexcept;
  static std::int16_t Saturate16(double value) noexcept;
  /// Per mille of the robot file's rated torque to per mille of the drive's, which has whole units only.
  std::int16_t ToDrive(std::int16_t permille) const noexcept {
    return Saturate16(permille * drive_permille_per_permille_);
  }
  std::int16_t FromDrive(std::int16_t permille) const noexcept {
    return Saturate16(permille / drive_permille_per_permille_);
  }
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
  /// Records one event, with the prefix "node N: ".
  [[gnu::format(printf, 4, 5)]] void Report(TimeNs now_ns, Status status, const char* format, ...) noexcept;

  const int id_;
  const DriveProfilePtr profile_;
  const Slots slots_;
  const std::vector<BootAction> script_;
  const std::vector<std::uint32_t> product_codes_;
  const std::uint32_t rated_torque_uNm_;
  double drive_permille_per_permille_ = 1;
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
  bool started_ = false;      // NMT start was sent
  bool ever_ready_ = false;   // since the last Boot by order
  bool reset_after_boot_ = false;
  TimeNs boot_deadline_ns_ = 0, probe_ns_ = 0, started_ns_ = 0;
  std::uint32_t product_code_ = 0, serial_ = 0;

  // running
  bool heartbeat_watched_ = false;
  TimeNs heartbeat_deadline_ns_ = 0;
  bool latched_ = false;     // a fault that only the operator clears
  bool may_enable_ = false;  // a disable request was seen since the boot or the last fault
  bool holds_ = false;       // enabled by us, and to stay so
  bool off_first_ = false;   // commanded to disable, and not reported disabled yet
  bool walking_ = false;     // on the way to operation enabled
  bool stops_ = false;       // lost, and repeatedly stopped by NMT
  AnswerWatch answers_;
  ReplyWatch replies_;
  int after_boot_up_ = 0;  // answers outstanding that a restarted drive cannot send; 0: no check
  TimeNs walk_deadline_ns_ = 0, stop_again_ns_ = 0, disable_deadline_ns_ = 0, refresh_ns_ = 0;
  Reset reset_ = Reset::kNone;
  bool rebooted_for_reset_ = false;
  TimeNs reset_deadline_ns_ = 0;
  bool released_ = false;
};

}  // namespace tendril::canopen
