// Cycle records with every field random, for round trips. Test use only.
#pragma once

#include <cstdint>
#include <random>

#include "tendril/core/cycle.h"
#include "tendril/io/gateway.h"

namespace tendril::io {

/// One section of four units and three tendons.
inline constexpr RobotShape kShape{1, 4, 3};

class RandomRecords {
 public:
  RandomRecords(const RobotShape& shape, unsigned seed) : shape_(shape), random_(seed) {}

  CycleRecord Next() {
    CycleRecord r;
    CycleInput& in = r.input;
    in.cycle = Integer<std::uint32_t>();
    in.time_ns = Integer<std::int64_t>() / 2;
    in.bus_ok = Coin();
    in.late = Coin();
    in.drives = shape_.tendons;
    for (int i = 0; i < in.drives; ++i) {
      DriveFeedback& d = in.drive[static_cast<std::size_t>(i)];
      d.state = static_cast<DriveState>(Below(6));
      d.statusword = Integer<std::uint16_t>();
      d.error_code = Integer<std::uint16_t>();
      d.position_counts = Integer<std::int32_t>();
      d.torque_permille = Integer<std::int16_t>();
      d.analog_mV = Integer<std::int16_t>();
      d.age_cycles = Integer<std::uint16_t>();
    }
    Command& c = in.command;
    c.kind = static_cast<CommandKind>(Below(5));
    c.sequence = Integer<std::uint32_t>();
    c.sender = Integer<std::uint32_t>();
    c.received_ns = Integer<std::int64_t>();
    c.valid_for_ns = Integer<std::int64_t>();
    c.mode = static_cast<ModeRequest>(Below(4));
    c.tip_W_m = Vector3();
    c.tip_velocity_W_mps = Vector3();
    // Sizes that do not fit the robot must come back as they were: the gate has to refuse them again in a
    // replay.
    c.bending_rad = Vector<BendingVector>(Below(2 * kMaxSections + 1));
    c.bending_rate_radps = Vector<BendingVector>(Below(2 * kMaxSections + 1));
    c.tension_N = Vector<TendonVector>(Below(kMaxTendons + 1));
    c.speed_radps = Double();
    in.tracker = {Coin(), Integer<std::int64_t>(), Vector3(), Quaternion()};

    CycleOutput& out = r.output;
    out.cycle = in.cycle;
    out.time_ns = in.time_ns;
    out.mode = static_cast<Mode>(Below(8));
    out.status = Coin() ? Status::kDriveFault : Status::kLimitedTorque;
    out.drive_request = static_cast<DriveRequest>(Below(2));
    out.clear_drive_faults = Coin();
    for (int i = 0; i < shape_.tendons; ++i) {
      out.torque_target_permille[static_cast<std::size_t>(i)] = Integer<std::int16_t>();
    }
    for (BendingVector* v :
         {&out.target_bending_rad, &out.reference.position_rad, &out.reference.velocity_radps,
          &out.reference.acceleration_radps2, &out.generalised_force_Nm, &out.bending_estimate_rad}) {
      *v = Vector<BendingVector>(2 * shape_.sections);
    }
    for (TendonVector* v : {&out.tension_desired_base_N, &out.sliding_direction, &out.tension_desired_motor_N,
                            &out.torque_desired_Nm, &out.displacement_desired_m, &out.displacement_m,
                            &out.tension_measured_N, &out.tension_base_estimate_N, &out.torque_measured_Nm}) {
      *v = Vector<TendonVector>(shape_.tendons);
    }
    out.target_tip_W_m = Vector3();
    out.target_distance_m = Double();
    out.reference_tip_W_m = Vector3();
    out.tip_estimate_W_m = Vector3();
    out.orientation_estimate_WT = Quaternion();
    out.commands_accepted = Integer<std::uint32_t>();
    out.commands_refused = Integer<std::uint32_t>();
    out.feedback_missing = Integer<std::uint32_t>();
    out.command_status = Coin() ? Status::kCommandStale : Status::kOk;

    r.timing = {Integer<std::int64_t>(), Integer<std::int64_t>(), Integer<std::int64_t>(),
                Integer<std::int64_t>(), Integer<std::uint32_t>()};
    return r;
  }

 private:
  template <class T>
  T Integer() {
    return static_cast<T>(random_());
  }
  bool Coin() { return (random_() & 1) != 0; }
  int Below(int n) { return static_cast<int>(random_() % static_cast<unsigned>(n)); }
  // Ordinary values, and those that careless conversions lose.
  double Double() {
    switch (Below(8)) {
      case 0:
        return -0.0;
      case 1:
        return std::numeric_limits<double>::infinity();
      case 2:
        return std::numeric_limits<double>::quiet_NaN();
      case 3:
        return std::numeric_limits<double>::denorm_min();
      default:
        return std::normal_distribution<double>(0, 10)(random_);
    }
  }
  Eigen::Vector3d Vector3() { return {Double(), Double(), Double()}; }
  Eigen::Quaterniond Quaternion() { return {Double(), Double(), Double(), Double()}; }
  template <class V>
  V Vector(int n) {
    V v(n);
    for (int i = 0; i < n; ++i) v[i] = Double();
    return v;
  }

  RobotShape shape_;
  std::mt19937_64 random_;
};

/// Expects every field of both to have the same bits.
void ExpectSameBits(const CycleRecord& a, const CycleRecord& b);

}  // namespace tendril::io
