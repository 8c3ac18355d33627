// One emulated drive of any profile: NMT, objects, PDOs, heartbeats, EMCY, and the power stage behind them.
// Knows its own frames and sensors only; nothing of the rack, the robot or a wall clock.
#pragma once

#include <array>

#include "object_dictionary.h"
#include "pdo.h"
#include "power_stage.h"
#include "sdo_server.h"
#include "tendril/canopen/wire.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {

class Drive final : private SdoObjects {
 public:
  Drive(const EmulatedDriveParameters& parameters, can::CanPort& port);
  Drive(const Drive&) = delete;
  Drive& operator=(const Drive&) = delete;

  int node_id() const noexcept { return node_id_; }

  void SetSensors(const DriveSensors& sensors) noexcept;
  void OnFrame(const can::CanFrame& frame, TimeNs now_ns);
  void OnSync(TimeNs now_ns);
  /// Performs all actions due at `now_ns`, boot-up first.
  void OnTime(TimeNs now_ns);

  double torque_Nm() const noexcept { return stage_.torque_Nm(); }
  bool powered() const noexcept { return stage_.powered(); }

  void InjectEmcy(std::uint16_t code);
  void SetFrozen(bool frozen) noexcept { frozen_ = frozen; }
  void PowerCycle() noexcept;
  void SetSupply(bool on) noexcept;
  void StickSensor(DriveSensor sensor, bool stuck) noexcept {
    stuck_[static_cast<std::size_t>(sensor)] = stuck;
  }
  void StopHeartbeat() noexcept { heartbeat_stopped_ = true; }
  void SetSto(bool active);

 private:
  static constexpr int kHistory = 5;                       // entries of 0x1003
  static constexpr std::uint16_t kSafeTorqueOff = 0x8A88;  // of an EPOS4; CiA 402 has no code of its own
  static bool SupportedMode(std::int64_t mode);

  struct Consumer {  // of one heartbeat, 0x1016
    const Object* setting = nullptr;
    bool heard = false;
    TimeNs deadline_ns = 0;
  };
  struct Event {  // of one TPDO that is sent on change
    bool sent = false;
    int size = 0;
    std::array<std::uint8_t, 8> data{};
    TimeNs next_ns = 0;  // end of the inhibit time
  };

  std::uint32_t Read(canopen::ObjectAddress address, std::span<std::uint8_t> to, std::size_t* size) override;
  std::uint32_t Write(canopen::ObjectAddress address, std::span<const std::uint8_t> from,
                      bool exact) override;
  std::uint32_t CheckWrite(const Object& object, std::int64_t value);
  std::uint32_t CheckCollision(const Pdo& pdo, const Object& object, std::uint32_t value) const;
  std::uint32_t CheckConsumer(const Object& object, std::uint32_t value) const;
  void AfterWrite(const Object& object);

  bool alive() const noexcept { return supplied_ && !frozen_; }
  void OnNmt(canopen::NmtCommand command);
  void OnHeartbeat(int node_id, TimeNs now_ns) noexcept;
  void OnReceivePdo(Pdo& pdo, std::size_t which, const can::CanFrame& frame);
  void Boot(TimeNs now_ns);
  void ResetCommunication() noexcept;
  void ConnectionEvent() noexcept;
  void TakeNodeId() noexcept;
  void RunHeartbeats(TimeNs now_ns);
  void SendEvents(TimeNs now_ns);
  void SendPdo(const Pdo& pdo);
  void SendEmcy(std::uint16_t code);

  void RefreshAll() noexcept;
  void RefreshRatedTorque() noexcept;
  void ActOnControlword();
  void RunStage(TimeNs now_ns) noexcept;
  void RunThermalModel(double dt_s) noexcept;
  void ShowProcessValues() noexcept;
  std::uint16_t Statusword() const noexcept;

  int node_id_;
  can::CanPort& port_;
  canopen::DriveProfilePtr profile_;
  ObjectDictionary objects_;
  std::array<Pdo, 4> rpdos_, tpdos_;
  SdoServer sdo_;
  PowerStage stage_;
  DriveSensors sensors_;

  canopen::NmtState nmt_ = canopen::NmtState::kBootUp;
  bool supplied_ = true, frozen_ = false, heartbeat_stopped_ = false;
  std::array<bool, 3> stuck_{};   // by DriveSensor
  bool connection_lost_ = false;  // heartbeat loss: no fault reset before NMT reset communication
  bool sto_ = false;              // an external input: unaffected by resets
  bool sto_error_ = false;        // error raised, and not reset yet
  bool i2t_limits_ = false;
  std::int64_t rated_at_mA_ = 0;  // nominal current from which the rated torque was computed
  double i2t_ = 0;                // winding heat, 1: steady state at the nominal current
  TimeNs now_ns_ = 0, stage_ns_ = 0, next_heartbeat_ns_ = 0;

  std::array<Consumer, 2> consumers_;
  struct Received {
    bool fresh = false;
    std::array<std::uint8_t, 8> data{};
  };
  std::array<Received, 4> received_;  // synchronous RPDO contents that wait for the next SYNC
  std::array<Event, 4> events_;

  // Objects used in each cycle.
  Object &error_register_, &heartbeat_time_, &nominal_current_, &current_limit_, &pole_pairs_, &thermal_time_,
      &torque_constant_, &sto_inputs_, &current_average_, &current_, &torque_average_, &analog1_, &analog2_,
      &error_code_, &controlword_, &statusword_, &mode_, &mode_shown_, &position_, &velocity_,
      &target_torque_, &torque_offset_, &rated_torque_, &torque_, &deceleration_;
  const Object* max_torque_;  // 0x6072, which not every drive has
};

}  // namespace tendril::emulator
