// A cycle's whole record, from which it can be replayed bit for bit; see the header.
#include <algorithm>

#include "tendril/core/limits.h"
#include "tendril/io/wire.h"
#include "wire_values.h"

namespace tendril::io {
namespace {

void FillCommand(const Command& c, tendril_lcm::cycle_t& m) {
  Number(m.command_kind, c.kind);
  Number(m.command_mode_request, c.mode);
  m.command_sequence = SequenceOf(c);
  m.command_received_ns = c.received_ns;
  m.command_valid_for_ns = c.valid_for_ns;
  m.command_speed_radps = c.speed_radps;
  Fill(m.command_tip_W_m, c.tip_W_m);
  Fill(m.command_tip_velocity_W_mps, c.tip_velocity_W_mps);
  Fill(m.command_bending_rad, c.bending_rad, m.num_command_bending);
  Fill(m.command_bending_rate_radps, c.bending_rate_radps, m.num_command_rate);
  Fill(m.command_tension_base_N, c.tension_N, m.num_command_tension);
}

// After the counts.
void FillInput(const CycleInput& in, tendril_lcm::cycle_t& m) {
  Number(m.cycle, in.cycle);
  m.time_ns = in.time_ns;
  m.bus_ok = in.bus_ok;
  m.late = in.late;
  const auto drives = static_cast<std::size_t>(m.num_drives);
  m.drive_state.resize(drives);
  m.drive_statusword.resize(drives);
  m.drive_error_code.resize(drives);
  m.drive_position_counts.resize(drives);
  m.drive_torque_permille.resize(drives);
  m.drive_analog_mV.resize(drives);
  m.drive_age_cycles.resize(drives);
  for (std::size_t i = 0; i < drives; ++i) {
    const DriveFeedback& d = in.drive[i];
    Number(m.drive_state[i], d.state);
    m.drive_statusword[i] = d.statusword;
    m.drive_error_code[i] = d.error_code;
    m.drive_position_counts[i] = d.position_counts;
    m.drive_torque_permille[i] = d.torque_permille;
    m.drive_analog_mV[i] = d.analog_mV;
    m.drive_age_cycles[i] = d.age_cycles;
  }

  m.tracker_valid = in.tracker.valid;
  m.tracker_time_ns = in.tracker.time_ns;
  Fill(m.tracker_tip_W_m, in.tracker.tip_W_m);
  Fill(m.tracker_orientation_WT, in.tracker.orientation_WT);
}

void FillEstimate(const CycleOutput& out, tendril_lcm::cycle_t& m) {
  const int nb = m.num_bending, nt = m.num_tendons;
  Fill(m.displacement_m, out.displacement_m, nt);
  Fill(m.tension_measured_N, out.tension_measured_N, nt);
  Fill(m.tension_base_estimate_N, out.tension_base_estimate_N, nt);
  Fill(m.torque_measured_Nm, out.torque_measured_Nm, nt);
  Fill(m.bending_estimate_rad, out.bending_estimate_rad, nb);
  Fill(m.tip_estimate_W_m, out.tip_estimate_W_m);
  Fill(m.orientation_estimate_WT, out.orientation_estimate_WT);
}

void FillDesired(const CycleOutput& out, tendril_lcm::cycle_t& m) {
  const int nb = m.num_bending, nt = m.num_tendons;
  Fill(m.target_tip_W_m, out.target_tip_W_m);
  m.target_distance_m = out.target_distance_m;
  Fill(m.target_bending_rad, out.target_bending_rad, nb);
  Fill(m.reference_bending_rad, out.reference.position_rad, nb);
  Fill(m.reference_rate_radps, out.reference.velocity_radps, nb);
  Fill(m.reference_acceleration_radps2, out.reference.acceleration_radps2, nb);
  Fill(m.reference_tip_W_m, out.reference_tip_W_m);
  Fill(m.generalised_force_Nm, out.generalised_force_Nm, nb);
  Fill(m.tension_desired_base_N, out.tension_desired_base_N, nt);
  Fill(m.sliding_direction, out.sliding_direction, nt);
  Fill(m.tension_desired_motor_N, out.tension_desired_motor_N, nt);
  Fill(m.torque_desired_Nm, out.torque_desired_Nm, nt);
  Fill(m.displacement_desired_m, out.displacement_desired_m, nt);
}

void FillOutput(const CycleOutput& out, tendril_lcm::cycle_t& m) {
  Number(m.mode, out.mode);
  Number(m.status, out.status);
  FillEstimate(out, m);
  FillDesired(out, m);

  Number(m.drive_request, out.drive_request);
  m.clear_drive_faults = out.clear_drive_faults;
  m.torque_target_permille.assign(out.torque_target_permille.begin(),
                                  out.torque_target_permille.begin() + m.num_tendons);

  m.commands_accepted = out.commands_accepted;
  m.commands_refused = out.commands_refused;
  Number(m.command_status, out.command_status);
  m.feedback_missing = out.feedback_missing;
}

void FillTiming(const CycleTiming& timing, tendril_lcm::cycle_t& m) {
  Number(m.deadline_misses, timing.deadline_misses);
  m.wake_latency_ns = timing.wake_latency_ns;
  m.feedback_ns = timing.feedback_ns;
  m.compute_ns = timing.compute_ns;
  m.total_ns = timing.total_ns;
}

bool WithinCapacity(const tendril_lcm::cycle_t& m) {
  constexpr int kMaxBending = 2 * kMaxSections;
  return m.num_drives <= kMaxTendons && m.num_command_bending <= kMaxBending &&
         m.num_command_rate <= kMaxBending && m.num_command_tension <= kMaxTendons &&
         m.num_bending <= kMaxBending && m.num_tendons <= kMaxTendons;
}

void TakeCommand(const tendril_lcm::cycle_t& m, Command& c) {
  Number(c.kind, m.command_kind);
  Number(c.mode, m.command_mode_request);
  TakeSequence(m.command_sequence, c);
  c.received_ns = m.command_received_ns;
  c.valid_for_ns = m.command_valid_for_ns;
  c.speed_radps = m.command_speed_radps;
  c.tip_W_m = FromArray(m.command_tip_W_m);
  c.tip_velocity_W_mps = FromArray(m.command_tip_velocity_W_mps);
  FromArray(m.command_bending_rad, m.num_command_bending, c.bending_rad);
  FromArray(m.command_bending_rate_radps, m.num_command_rate, c.bending_rate_radps);
  FromArray(m.command_tension_base_N, m.num_command_tension, c.tension_N);
}

void TakeInput(const tendril_lcm::cycle_t& m, CycleInput& in) {
  Number(in.cycle, m.cycle);
  in.time_ns = m.time_ns;
  in.bus_ok = m.bus_ok != 0;
  in.late = m.late != 0;
  in.drives = m.num_drives;
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.num_drives); ++i) {
    DriveFeedback& d = in.drive[i];
    Number(d.state, m.drive_state[i]);
    Number(d.statusword, m.drive_statusword[i]);
    Number(d.error_code, m.drive_error_code[i]);
    d.position_counts = m.drive_position_counts[i];
    d.torque_permille = m.drive_torque_permille[i];
    d.analog_mV = m.drive_analog_mV[i];
    Number(d.age_cycles, m.drive_age_cycles[i]);
  }

  in.tracker.valid = m.tracker_valid != 0;
  in.tracker.time_ns = m.tracker_time_ns;
  in.tracker.tip_W_m = FromArray(m.tracker_tip_W_m);
  in.tracker.orientation_WT = TakeQuaternion(m.tracker_orientation_WT);
}

void TakeEstimate(const tendril_lcm::cycle_t& m, CycleOutput& out) {
  const int nb = m.num_bending, nt = m.num_tendons;
  FromArray(m.displacement_m, nt, out.displacement_m);
  FromArray(m.tension_measured_N, nt, out.tension_measured_N);
  FromArray(m.tension_base_estimate_N, nt, out.tension_base_estimate_N);
  FromArray(m.torque_measured_Nm, nt, out.torque_measured_Nm);
  FromArray(m.bending_estimate_rad, nb, out.bending_estimate_rad);
  out.tip_estimate_W_m = FromArray(m.tip_estimate_W_m);
  out.orientation_estimate_WT = TakeQuaternion(m.orientation_estimate_WT);
}

void TakeDesired(const tendril_lcm::cycle_t& m, CycleOutput& out) {
  const int nb = m.num_bending, nt = m.num_tendons;
  out.target_tip_W_m = FromArray(m.target_tip_W_m);
  out.target_distance_m = m.target_distance_m;
  FromArray(m.target_bending_rad, nb, out.target_bending_rad);
  FromArray(m.reference_bending_rad, nb, out.reference.position_rad);
  FromArray(m.reference_rate_radps, nb, out.reference.velocity_radps);
  FromArray(m.reference_acceleration_radps2, nb, out.reference.acceleration_radps2);
  out.reference_tip_W_m = FromArray(m.reference_tip_W_m);
  FromArray(m.generalised_force_Nm, nb, out.generalised_force_Nm);
  FromArray(m.tension_desired_base_N, nt, out.tension_desired_base_N);
  FromArray(m.sliding_direction, nt, out.sliding_direction);
  FromArray(m.tension_desired_motor_N, nt, out.tension_desired_motor_N);
  FromArray(m.torque_desired_Nm, nt, out.torque_desired_Nm);
  FromArray(m.displacement_desired_m, nt, out.displacement_desired_m);
}

void TakeOutput(const tendril_lcm::cycle_t& m, CycleOutput& out) {
  Number(out.cycle, m.cycle);
  out.time_ns = m.time_ns;
  Number(out.mode, m.mode);
  Number(out.status, m.status);
  TakeEstimate(m, out);
  TakeDesired(m, out);

  Number(out.drive_request, m.drive_request);
  out.clear_drive_faults = m.clear_drive_faults != 0;
  std::copy(m.torque_target_permille.begin(), m.torque_target_permille.begin() + m.num_tendons,
            out.torque_target_permille.begin());

  Number(out.commands_accepted, m.commands_accepted);
  Number(out.commands_refused, m.commands_refused);
  Number(out.command_status, m.command_status);
  Number(out.feedback_missing, m.feedback_missing);
}

void TakeTiming(const tendril_lcm::cycle_t& m, CycleTiming& timing) {
  Number(timing.deadline_misses, m.deadline_misses);
  timing.wake_latency_ns = m.wake_latency_ns;
  timing.feedback_ns = m.feedback_ns;
  timing.compute_ns = m.compute_ns;
  timing.total_ns = m.total_ns;
}

}  // namespace

void ToMessage(const CycleRecord& record, const RobotShape& shape, std::int64_t utime,
               tendril_lcm::cycle_t& m) {
  const Command& c = record.input.command;
  m.utime = utime;
  m.num_drives = std::clamp(record.input.drives, 0, kMaxTendons);
  m.num_command_bending = static_cast<int>(c.bending_rad.size());
  m.num_command_rate = static_cast<int>(c.bending_rate_radps.size());
  m.num_command_tension = static_cast<int>(c.tension_N.size());
  m.num_bending = 2 * shape.sections;
  m.num_tendons = shape.tendons;
  FillInput(record.input, m);
  FillCommand(c, m);
  FillOutput(record.output, m);
  FillTiming(record.timing, m);
}

bool FromMessage(const tendril_lcm::cycle_t& m, CycleRecord& record) noexcept {
  if (!WithinCapacity(m)) return false;
  record = CycleRecord{};
  TakeInput(m, record.input);
  TakeCommand(m, record.input.command);
  TakeOutput(m, record.output);
  TakeTiming(m, record.timing);
  return true;
}

}  // namespace tendril::io
