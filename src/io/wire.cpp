// Conversions between structs and messages; see the header.
#include "tendril/io/wire.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <string_view>
#include <vector>

#include "tendril/io/client.h"
#include "tendril/io/epoch.h"
#include "wire_values.h"

namespace tendril::io {
namespace {

constexpr std::size_t kHashBytes = 8;

// A validity beyond the integer's range becomes one that the gate refuses.
TimeNs ToNs(double seconds) {
  if (std::isnan(seconds)) return 0;
  constexpr double kLongS = 1e9;
  return static_cast<TimeNs>(std::clamp(seconds, -kLongS, kLongS) * static_cast<double>(kNsPerS));
}

template <class Message>
void TakeHeader(const Message& m, CommandKind kind, Command& c) {
  c = Command{};
  c.kind = kind;
  TakeSequence(m.sequence, c);
  c.valid_for_ns = ToNs(m.valid_for_s);
}

std::string TooMany(const char* what, int n, int most) {
  return std::string(what) + " has " + std::to_string(n) + " values, at most " + std::to_string(most) +
         " are possible";
}

// YAML readers ignore it.
const std::string kDaemonLine = "# daemon: ";

}  // namespace

bool CountsPlausible(const void* data, int size, int counts) noexcept {
  const auto bytes =
      std::span(static_cast<const std::uint8_t*>(data), static_cast<std::size_t>(std::max(size, 0)));
  if (bytes.size() < kHashBytes + 4 * static_cast<std::size_t>(counts)) return false;
  std::uint64_t sum = 0;
  for (int i = 0; i < counts; ++i) {
    const auto at = bytes.subspan(kHashBytes + 4 * static_cast<std::size_t>(i), 4);
    const std::uint32_t n = (std::uint32_t{at[0]} << 24) | (std::uint32_t{at[1]} << 16) |
                            (std::uint32_t{at[2]} << 8) | std::uint32_t{at[3]};
    sum += n;
  }
  return sum <= bytes.size();
}

std::int64_t EpochOffsetUs(const Clock& clock) {
  if (dynamic_cast<const MonotonicClock*>(&clock) == nullptr) return 0;
  return EpochUs() - clock.Now() / kNsPerUs;
}

void ToMessage(const CycleRecord& record, const RobotShape& shape, std::int64_t utime,
               tendril_lcm::state_t& m) {
  const CycleOutput& out = record.output;
  const int nb = 2 * shape.sections;
  const int nt = shape.tendons;
  m.num_bending = nb;
  m.num_tendons = nt;
  m.num_covariance = nb * nb;
  m.utime = utime;
  Number(m.cycle, record.input.cycle);

  Number(m.mode, out.mode);
  m.mode_text = ModeText(out.mode);
  Number(m.status, out.status);
  m.status_text = StatusText(out.status);
  m.status_remedy = StatusRemedy(out.status);
  m.reported.clear();
  for (const Status s : out.reported)
    if (s != Status::kOk) m.reported.push_back(static_cast<std::int16_t>(s));
  std::sort(m.reported.begin(), m.reported.end(), std::greater<>());
  Number(m.num_reported, m.reported.size());

  m.commands_accepted = out.commands_accepted;
  m.commands_refused = out.commands_refused;
  if (record.input.command.kind != CommandKind::kNone) m.command_sequence = SequenceOf(record.input.command);
  Number(m.command_status, out.command_status);
  m.command_status_text = StatusText(out.command_status);
  if (const std::string_view remedy = StatusRemedy(out.command_status); !remedy.empty()) {
    m.command_status_text += "; ";
    m.command_status_text += remedy;
  }

  Fill(m.target_tip_W_m, out.target_tip_W_m);
  m.target_distance_m = out.target_distance_m;
  Fill(m.bending_target_rad, out.target_bending_rad, nb);
  Fill(m.bending_desired_rad, out.reference.position_rad, nb);
  Fill(m.bending_rate_desired_radps, out.reference.velocity_radps, nb);
  Fill(m.bending_estimate_rad, out.bending_estimate_rad, nb);
  Fill(m.bending_covariance_rad2, out.bending_covariance_rad2, nb * nb);  // symmetric: rows are columns
  Fill(m.tip_desired_W_m, out.reference_tip_W_m);
  Fill(m.tip_estimate_W_m, out.tip_estimate_W_m);
  Fill(m.orientation_estimate_WT, out.orientation_estimate_WT);

  Fill(m.tension_desired_base_N, out.tension_desired_base_N, nt);
  Fill(m.tension_desired_motor_N, out.tension_desired_motor_N, nt);
  Fill(m.tension_measured_N, out.tension_measured_N, nt);
  Fill(m.tension_base_estimate_N, out.tension_base_estimate_N, nt);
  Fill(m.displacement_desired_m, out.displacement_desired_m, nt);
  Fill(m.displacement_m, out.displacement_m, nt);
  Fill(m.torque_desired_Nm, out.torque_desired_Nm, nt);
  Fill(m.torque_measured_Nm, out.torque_measured_Nm, nt);
}

namespace {

void Fill(const LatencyStatistics& from, std::vector<std::int64_t>& counts, std::int64_t (&percentiles)[4]) {
  counts.assign(from.counts.begin(), from.counts.end());
  percentiles[0] = from.median_ns;
  percentiles[1] = from.p99_ns;
  percentiles[2] = from.p999_ns;
  percentiles[3] = from.max_ns;
}

}  // namespace

void ToMessage(const LoopStatistics& s, std::int64_t utime, tendril_lcm::statistics_t& m) {
  m.utime = utime;
  Number(m.cycles, s.cycles);
  Number(m.deadline_misses, s.deadline_misses);
  m.num_bins = kLatencyBins;
  m.bin_below_ns.clear();
  for (int bin = 0; bin < kLatencyBins; ++bin) m.bin_below_ns.push_back(LatencyBinBelow_ns(bin));
  Fill(s.wake_latency, m.wake_latency_counts, m.wake_latency_ns);
  Fill(s.compute, m.compute_counts, m.compute_ns);
  Fill(s.round_trip, m.round_trip_counts, m.round_trip_ns);

  m.num_misses = static_cast<std::int32_t>(s.misses.size());
  m.miss_cycle.clear();
  m.miss_skipped.clear();
  m.miss_cause.clear();
  for (const MissedCycles& miss : s.misses) {
    m.miss_cycle.push_back(static_cast<std::int64_t>(miss.cycle));
    m.miss_skipped.push_back(static_cast<std::int64_t>(miss.skipped));
    m.miss_cause.push_back(miss.cause);
  }

  Number(m.messages_ignored, s.messages_ignored);
  Number(m.publish_failed, s.publish_failed);
  m.last_fault_utime = s.last_fault.utime;
  Number(m.last_fault_status, s.last_fault.status);
  m.last_fault_text = s.last_fault.text;

  Number(m.can_sent, s.can_sent);
  Number(m.can_received, s.can_received);
  Number(m.can_send_refused, s.can_send_refused);
  Number(m.can_receive_dropped, s.can_receive_dropped);
  Number(m.can_error_frames, s.can_error_frames);
  Number(m.can_bus_off, s.can_bus_off);
  Number(m.can_malformed, s.can_malformed);
  Number(m.can_foreign, s.can_foreign);
  m.bus_load = s.bus_load;
  m.num_drives = static_cast<std::int32_t>(s.drives.size());
  m.drive_node_id.clear();
  m.drive_state.clear();
  m.drive_statusword.clear();
  m.drive_error_code.clear();
  m.drive_serial.clear();
  m.drive_age_cycles.clear();
  m.drive_worst_age_cycles.clear();
  for (const DriveStatistics& drive : s.drives) {
    m.drive_node_id.push_back(drive.node_id);
    m.drive_state.push_back(static_cast<std::int8_t>(drive.state));
    m.drive_statusword.push_back(drive.statusword);
    m.drive_error_code.push_back(drive.error_code);
    m.drive_serial.push_back(drive.serial);
    m.drive_age_cycles.push_back(drive.age_cycles);
    m.drive_worst_age_cycles.push_back(drive.worst_age_cycles);
  }

  Number(m.voluntary_switches, s.voluntary_switches);
  Number(m.involuntary_switches, s.involuntary_switches);
  Number(m.minor_faults, s.minor_faults);
  Number(m.major_faults, s.major_faults);
}

void ToMessage(const RunInfo& run, const RobotShape& shape, std::int64_t utime, tendril_lcm::run_t& m) {
  m.utime = utime;
  m.start_utime = run.start_utime;
  m.num_sections = shape.sections;
  m.num_units = shape.units;
  m.num_tendons = shape.tendons;
  m.version = run.version;
  m.git_revision = run.git_revision;
  m.robot_yaml = run.robot_yaml;
  m.daemon_yaml = run.daemon.empty() ? "" : kDaemonLine + run.daemon + "\n";
  m.daemon_yaml += run.daemon_yaml;
}

void FromMessage(const tendril_lcm::run_t& m, RunInfo& run) {
  run = {m.robot_yaml, m.daemon_yaml, m.version, m.git_revision, m.start_utime, {}};
  if (!run.daemon_yaml.starts_with(kDaemonLine)) return;
  const std::size_t begin = kDaemonLine.size(), end = run.daemon_yaml.find('\n');
  if (end == std::string::npos) return;
  run.daemon = run.daemon_yaml.substr(begin, end - begin);
  run.daemon_yaml.erase(0, end + 1);
}

std::string FromMessage(const tendril_lcm::command_tip_t& m, Command& c) {
  TakeHeader(m, CommandKind::kTip, c);
  c.speed_radps = m.speed_radps;
  c.tip_W_m = FromArray(m.tip_W_m);
  c.tip_velocity_W_mps = FromArray(m.tip_velocity_W_mps);
  return {};
}

std::string FromMessage(const tendril_lcm::command_bending_t& m, Command& c) {
  constexpr int kMost = 2 * kMaxSections;
  if (m.num_bending > kMost) return TooMany("bending_rad", m.num_bending, kMost);
  if (m.num_rate > kMost) return TooMany("bending_rate_radps", m.num_rate, kMost);
  TakeHeader(m, CommandKind::kBending, c);
  c.speed_radps = m.speed_radps;
  FromArray(m.bending_rad, m.num_bending, c.bending_rad);
  FromArray(m.bending_rate_radps, m.num_rate, c.bending_rate_radps);
  return {};
}

std::string FromMessage(const tendril_lcm::command_tension_t& m, Command& c) {
  if (m.num_tendons > kMaxTendons) return TooMany("tension_base_N", m.num_tendons, kMaxTendons);
  TakeHeader(m, CommandKind::kTension, c);
  c.speed_radps = m.speed_radps;
  FromArray(m.tension_base_N, m.num_tendons, c.tension_N);
  return {};
}

std::string FromMessage(const tendril_lcm::command_mode_t& m, Command& c) {
  using M = tendril_lcm::command_mode_t;
  if (m.request < M::ARM || m.request > M::HOME) {
    return "request " + std::to_string(m.request) +
           " is none of 0 arm, 1 disarm, 2 hold, 3 clear, 4 commission, 5 home";
  }
  TakeHeader(m, CommandKind::kMode, c);
  Number(c.mode, m.request);
  return {};
}

}  // namespace tendril::io
