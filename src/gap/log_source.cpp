// Reads runs from LCM logs of the daemon or the demo. Knows the drives' objects and the contents of a cycle;
// does not use the controller's estimates as measurements.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <optional>

#include "file_bytes.h"
#include "row_times.h"
#include "sources.h"
#include "tendril/config/config.h"
#include "tendril/core/drive_counts.h"
#include "tendril/io/log.h"

namespace tendril::gap {
namespace {

bool Enabled(const CycleRecord& record) {
  return std::all_of(record.input.drive.begin(), record.input.drive.begin() + record.input.drives,
                     [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
}

/// Drives enabled and the robot tensioned: after pretension, before release.
bool Measured(const CycleRecord& record) {
  const Mode mode = record.output.mode;
  return (mode == Mode::kRunning || mode == Mode::kHold) && Enabled(record);
}

std::int32_t CountsSince(const CycleRecord& zero, const CycleRecord& now, std::size_t drive) {
  return CountsMoved(now.input.drive[drive].position_counts, zero.input.drive[drive].position_counts);
}

/// Counts of each drive at the controller's zero, from the displacement in one cycle. The controller keeps
/// the zero of the first arming, and a log may begin later.
std::vector<std::int32_t> ZeroCounts(const CycleRecord& cycle, const RobotParameters& controllers) {
  std::vector<std::int32_t> zero;
  constexpr double kMost = std::numeric_limits<std::int32_t>::max();
  const TendonVector& displacement_m = cycle.output.displacement_m;
  for (const auto& tendon : controllers.actuation->tendons) {
    const std::size_t d = zero.size();
    const auto row = static_cast<Eigen::Index>(d);
    const double count_m =
        2 * std::numbers::pi / tendon.drive.encoder_counts_per_turn * tendon.SpoolTravelPerMotorRad();
    const double moved = row < displacement_m.size() ? displacement_m[row] / count_m : 0;
    const bool known = std::abs(moved) < kMost;
    zero.push_back(CountsMoved(cycle.input.drive[d].position_counts,
                               known ? static_cast<std::int32_t>(std::lround(moved)) : 0));
  }
  return zero;
}

/// First cycle of the rest before `running`: tensioned, and no motor more than three counts from its later
/// position; at most half a second.
std::size_t BeginOfRest(const std::vector<CycleRecord>& cycles, std::size_t running) {
  constexpr int kStillCounts = 3;
  const CycleRecord& zero = cycles[running];
  std::size_t begin = running;
  while (begin > 0) {
    const CycleRecord& before = cycles[begin - 1];
    if (before.output.mode != Mode::kPretension || !Enabled(before)) break;
    if (ToSeconds(zero.input.time_ns) - ToSeconds(before.input.time_ns) > 0.5) break;
    bool still = true;
    for (std::size_t d = 0; d < static_cast<std::size_t>(zero.input.drives); ++d) {
      const std::int32_t counts = CountsSince(zero, before, d);
      still = still && counts >= -kStillCounts && counts <= kStillCounts;
    }
    if (!still) break;
    --begin;
  }
  return begin;
}

/// The usual number of cycles per record: logs may hold every n-th cycle.
std::uint64_t Stride(const std::vector<CycleRecord>& cycles) {
  std::vector<std::uint64_t> steps;
  for (std::size_t i = 1; i < cycles.size(); ++i) {
    const std::uint64_t before = cycles[i - 1].input.cycle, now = cycles[i].input.cycle;
    if (now > before) steps.push_back(now - before);
  }
  if (steps.empty()) return 1;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

/// True when time increases from one cycle to the next by no more than a plausible pause.
bool Follows(const CycleRecord& before, const CycleRecord& now) {
  constexpr std::uint64_t kLongest_ns = 100'000ULL * kNsPerS;
  const TimeNs a = before.input.time_ns, b = now.input.time_ns;
  return b > a && static_cast<std::uint64_t>(b) - static_cast<std::uint64_t>(a) < kLongest_ns &&
         now.input.cycle > before.input.cycle;
}

class LogRun {
 public:
  /// The cycles from `running` to `last` and the rest before them; `controllers`: the robot of the log's
  /// controller.
  LogRun(const io::LogContents& log, std::size_t running, std::size_t last, const RobotParameters& robot,
         const RobotParameters& controllers)
      : cycles_(log.cycles),
        offsets_(log.offsets),
        first_(BeginOfRest(cycles_, running)),
        last_(last),
        robot_(robot) {
    // The first cycle still has the previous zero.
    zero_counts_ = ZeroCounts(cycles_[std::min(running + 1, last - 1)], controllers);
  }

  /// Fewer than two rows when the log is damaged.
  Run Make() {
    const std::vector<std::size_t> kept = KeptCycles();
    if (kept.size() < 2) return {};
    const auto rows = static_cast<Eigen::Index>(kept.size());
    const auto tendons = static_cast<Eigen::Index>(robot_.actuation->tendons.size());
    run_.time_s.resize(rows);
    for (Eigen::MatrixXd* m : {&run_.torque_target_Nm, &run_.torque_actual_Nm, &run_.motor_position_rad}) {
      m->resize(rows, tendons);
    }
    const bool cell = CellPlace(robot_) != LoadCellPlace::kNone;
    run_.tension_N.resize(rows, cell ? tendons : 0);
    const TimeNs start_ns = cycles_[kept.front()].input.time_ns;
    for (Eigen::Index i = 0; i < rows; ++i) {
      const std::size_t at = kept[static_cast<std::size_t>(i)];
      run_.time_s[i] = ToSeconds(cycles_[at].input.time_ns - start_ns);
      for (int j = 0; j < static_cast<int>(tendons); ++j) FillDrive(i, at, j);
    }
    FillTracker(kept);
    NoteLost(kept);
    if (stale_ > 0)
      run_.notes.push_back(fmt::format("{} drive answers did not arrive in their cycle: missing", stale_));
    return std::move(run_);
  }

 private:
  // A damaged or joined log may repeat cycles.
  std::vector<std::size_t> KeptCycles() {
    std::vector<std::size_t> kept;
    for (std::size_t i = first_; i < last_; ++i) {
      if (!kept.empty() && !Follows(cycles_[kept.back()], cycles_[i])) continue;
      kept.push_back(i);
    }
    if (const std::size_t lost = last_ - first_ - kept.size(); lost > 0) {
      run_.warnings.push_back(fmt::format("{} cycles whose time does not increase dropped", lost));
    }
    return kept;
  }

  void FillDrive(Eigen::Index row, std::size_t at, int j) {
    const auto& tendon = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    const auto d = static_cast<std::size_t>(j);
    const DriveFeedback& drive = cycles_[at].input.drive[d];
    const double rated_Nm = tendon.drive.rated_torque_Nm * 1e-3;
    run_.torque_target_Nm(row, j) = cycles_[at].output.torque_target_permille[d] * rated_Nm;
    const bool fresh = drive.age_cycles == 0;
    if (!fresh) ++stale_;
    const std::int32_t counts = CountsMoved(drive.position_counts, zero_counts_[d]);
    run_.motor_position_rad(row, j) = fresh ? MotorAngle_rad(tendon.drive, counts) : kNoReading;
    run_.torque_actual_Nm(row, j) = fresh ? drive.torque_permille * rated_Nm : kNoReading;
    if (run_.tension_N.cols() > 0) {
      const bool cell = tendon.load_cell.place != LoadCellPlace::kNone && tendon.load_cell.gain_VpN > 0;
      run_.tension_N(row, j) =
          fresh && cell ? drive.analog_mV * 1e-3 / tendon.load_cell.gain_VpN - tendon.load_cell.offset_N
                        : kNoReading;
    }
  }

  // A reading belongs to the row nearest to its measurement time, not to the row of its arrival.
  void FillTracker(const std::vector<std::size_t>& kept) {
    const auto rows = static_cast<Eigen::Index>(kept.size());
    std::vector<const TrackerSample*> samples;
    // Readings of the last rows arrive after them.
    const std::size_t end = std::min(cycles_.size(), last_ + 100);
    for (std::size_t i = first_; i < end; ++i) {
      if (cycles_[i].input.tracker.valid) samples.push_back(&cycles_[i].input.tracker);
    }
    if (samples.empty()) return;
    run_.tip_m.setConstant(rows, 3, kNoReading);
    run_.tip_quaternion.setConstant(rows, 4, kNoReading);
    const TimeNs start_ns = cycles_[kept.front()].input.time_ns;
    int used = 0;
    for (const TrackerSample* sample : samples) {
      const double t = ToSeconds(sample->time_ns) - ToSeconds(start_ns);
      const double* const begin = run_.time_s.data();
      auto row = static_cast<Eigen::Index>(std::lower_bound(begin, begin + rows, t) - begin);
      if (row == rows || (row > 0 && t - run_.time_s[row - 1] < run_.time_s[row] - t)) --row;
      const double step = row > 0 ? run_.time_s[row] - run_.time_s[row - 1] : run_.time_s[1] - run_.time_s[0];
      if (row < 0 || std::abs(run_.time_s[row] - t) > 0.51 * step) continue;
      const Eigen::Quaterniond& q = sample->orientation_WT;
      if (!sample->tip_W_m.allFinite() || !(std::abs(q.norm() - 1) < 0.05)) continue;
      run_.tip_m.row(row) = sample->tip_W_m.transpose();
      run_.tip_quaternion.row(row) << q.w(), q.x(), q.y(), q.z();
      ++used;
    }
    if (used > 0) return;
    run_.tip_m.resize(0, 0);
    run_.tip_quaternion.resize(0, 0);
  }

  void NoteLost(const std::vector<std::size_t>& kept) {
    const std::uint64_t stride = Stride(cycles_);
    std::uint64_t lost = 0, before = 0;
    for (std::size_t i = 1; i < kept.size(); ++i) {
      const std::uint64_t step = cycles_[kept[i]].input.cycle - cycles_[kept[i - 1]].input.cycle;
      if (step <= stride) continue;
      if (lost == 0) before = offsets_[kept[i]];
      lost += step / stride - 1;
    }
    if (stride > 1) run_.notes.push_back(fmt::format("the log holds every {}-th cycle only", stride));
    if (lost > 0)
      run_.notes.push_back(fmt::format("{} missing from the log, the first before the event at byte {}",
                                       lost == 1 ? "1 cycle is" : fmt::format("{} cycles are", lost),
                                       before));
    NoteGaps(run_);
  }

  const std::vector<CycleRecord>& cycles_;
  const std::vector<std::uint64_t>& offsets_;
  std::size_t first_, last_;
  const RobotParameters& robot_;
  std::vector<std::int32_t> zero_counts_;
  int stale_ = 0;
  Run run_;
};

/// The robot of the controller; empty where the log has none, or one that this version cannot read.
std::optional<RobotParameters> ControllersRobot(const io::RunInfo& run, int tendons) {
  if (run.robot_yaml.empty()) return std::nullopt;
  try {
    RobotParameters robot = config::ParseRobot(run.robot_yaml, "robot of the log");
    if (robot.actuation && std::ssize(robot.actuation->tendons) == tendons) return robot;
  } catch (const std::exception&) {
    // Counts are then interpreted with the given robot.
  }
  return std::nullopt;
}

}  // namespace

// A log whose first bytes are damaged is recognised by its name.
bool IsLcmLog(const std::filesystem::path& file) {
  if (file.extension() == ".lcmlog") return true;
  std::ifstream in(file, std::ios::binary);
  std::array<char, 4> sync{};
  in.read(sync.data(), sync.size());
  return in.gcount() == 4 && sync == std::array<char, 4>{'\xED', '\xA1', '\xDA', '\x01'};
}

std::string RobotYamlOfLog(const std::filesystem::path& file) {
  return io::ReadLog(file.string()).run.robot_yaml;
}

std::vector<Run> ReadRunLog(const std::filesystem::path& file, const RobotOfSet& of_set,
                            std::vector<std::string>& notes) {
  const RobotParameters& robot = of_set.robot();
  const std::string name = file.string();
  if (!robot.actuation) {
    throw std::runtime_error(
        name + ": robot '" + robot.name +
        "' has no actuation, so that counts and millivolts mean nothing; use a rig file such as "
        "rig_60mm.yaml");
  }
  const io::LogContents log = io::ReadLog(name);
  of_set.Check(log.run.robot_yaml, name, notes);
  if (log.cycles.empty()) {
    throw std::runtime_error(name + ": no cycle in this log" +
                             (log.damage.empty() ? "" : " (damaged: " + log.damage + ")") +
                             "; accepted: a log with the channel ..._CYCLE; set lcm.cycle_every_cycles to 1");
  }
  const int tendons = static_cast<int>(robot.actuation->tendons.size());
  if (const int drives = log.cycles.front().input.drives; drives != tendons) {
    throw std::runtime_error(
        fmt::format("{}: the log is of {} drives, robot '{}' has {} tendons; give the robot's own "
                    "file",
                    name, drives, robot.name, tendons));
  }
  const std::string sha256 = Sha256(ReadBytes(file));
  const std::optional<RobotParameters> controllers = ControllersRobot(log.run, tendons);
  std::vector<Run> runs;
  for (std::size_t first = 0; first < log.cycles.size();) {
    if (!Measured(log.cycles[first])) {
      ++first;
      continue;
    }
    std::size_t last = first;
    while (last < log.cycles.size() && Measured(log.cycles[last])) ++last;
    if (Run run = LogRun(log, first, last, robot, controllers ? *controllers : robot).Make();
        run.time_s.size() >= 2) {
      run.name = RunName(file);
      // A log is always called run.lcmlog, so the run takes the name of its folder.
      if (run.name == "run" && std::filesystem::absolute(file).parent_path().has_filename()) {
        run.name = std::filesystem::absolute(file).lexically_normal().parent_path().filename().string();
      }
      run.family = "unknown";
      run.sha256 = sha256;
      run.load_cell = CellPlace(robot);
      run.zero_at_rest = true;
      if (!log.damage.empty()) run.warnings.push_back("the log is damaged: " + log.damage);
      runs.push_back(std::move(run));
    }
    first = last;
  }
  if (runs.empty()) {
    throw std::runtime_error(name +
                             ": the drives are never enabled and tensioned in this log; accepted: a run with "
                             "arming, motion and disarming");
  }
  return runs;
}

}  // namespace tendril::gap
