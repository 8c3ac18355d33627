// Replay of logs; see the header.
#include "tendril/experiment/log_replay.h"

#include <fmt/format.h>

#include <bit>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <type_traits>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/control/controller.h"
#include "tendril/io/log.h"

namespace tendril::experiment {
namespace {

class Comparison {
 public:
  template <class T>
  void Value(std::string_view field, const T& logged, const T& replayed) {
    if (found) return;
    if constexpr (std::is_enum_v<T>) {
      Value(field, static_cast<std::underlying_type_t<T>>(logged),
            static_cast<std::underlying_type_t<T>>(replayed));
    } else if constexpr (std::is_same_v<T, double>) {
      const auto a = std::bit_cast<std::uint64_t>(logged), b = std::bit_cast<std::uint64_t>(replayed);
      Note(field, a ^ b, [&] {
        return std::pair(fmt::format("{:.17g} (0x{:016x})", logged, a),
                         fmt::format("{:.17g} (0x{:016x})", replayed, b));
      });
    } else {
      Note(field, static_cast<std::uint64_t>(logged) ^ static_cast<std::uint64_t>(replayed),
           [&] { return std::pair(fmt::format("{}", +logged), fmt::format("{}", +replayed)); });
    }
  }
  template <class V>
  void Vector(std::string_view field, const V& logged, const V& replayed) {
    if (logged.size() != replayed.size()) {
      Value(fmt::format("number of {}", field), logged.size(), replayed.size());
      return;
    }
    for (Eigen::Index i = 0; i < logged.size() && !found; ++i) {
      Value(fmt::format("{}[{}]", field, i), double{logged[i]}, double{replayed[i]});
    }
  }

  std::optional<Difference> found;

 private:
  template <class Texts>
  void Note(std::string_view field, std::uint64_t bits, Texts texts) {
    if (bits == 0) return;
    found.emplace();
    found->field = field;
    found->bit = std::countr_zero(bits);
    std::tie(found->logged, found->replayed) = texts();
  }
};

std::unique_ptr<control::Controller> MakeController(const io::RunInfo& run,
                                                    const std::optional<RobotParameters>& robot,
                                                    const std::optional<DaemonParameters>& parameters) {
  const DaemonParameters p =
      parameters ? *parameters : config::ParseDaemon(run.daemon_yaml, "log's daemon file");
  return std::make_unique<control::Controller>(
      robot ? *robot : config::ParseRobot(run.robot_yaml, "log's robot file"), p.controller, p.bus.cycle_ns);
}

/// Of what a controller makes of the drives' values of the same cycle alone, but for a zero.
bool ReadingsDiffer(const CycleOutput& a, const CycleOutput& b) {
  Comparison c;
  c.Vector("", a.displacement_m, b.displacement_m);
  c.Vector("", a.tension_measured_N, b.tension_measured_N);
  c.Vector("", a.torque_measured_Nm, b.torque_measured_Nm);
  return c.found.has_value();
}

}  // namespace

std::optional<Difference> FirstDifference(const CycleOutput& a, const CycleOutput& b) {
  Comparison c;
#define TENDRIL_VALUE(field) c.Value(#field, a.field, b.field)
#define TENDRIL_VECTOR(field) c.Vector(#field, a.field, b.field)
  TENDRIL_VECTOR(displacement_m);
  TENDRIL_VECTOR(tension_measured_N);
  TENDRIL_VECTOR(tension_base_estimate_N);
  TENDRIL_VECTOR(torque_measured_Nm);
  TENDRIL_VECTOR(bending_estimate_rad);
  TENDRIL_VECTOR(tip_estimate_W_m);
  // In a message a quaternion is w, x, y, z.
  const auto wxyz = [](const Eigen::Quaterniond& q) { return Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()); };
  c.Vector("orientation_estimate_WT", wxyz(a.orientation_estimate_WT), wxyz(b.orientation_estimate_WT));
  TENDRIL_VALUE(commands_accepted);
  TENDRIL_VALUE(commands_refused);
  TENDRIL_VALUE(command_status);
  TENDRIL_VALUE(clear_drive_faults);
  TENDRIL_VALUE(feedback_missing);
  TENDRIL_VALUE(mode);
  TENDRIL_VALUE(drive_request);
  TENDRIL_VECTOR(target_tip_W_m);
  TENDRIL_VALUE(target_distance_m);
  TENDRIL_VECTOR(target_bending_rad);
  c.Vector("reference_bending_rad", a.reference.position_rad, b.reference.position_rad);
  c.Vector("reference_rate_radps", a.reference.velocity_radps, b.reference.velocity_radps);
  c.Vector("reference_acceleration_radps2", a.reference.acceleration_radps2, b.reference.acceleration_radps2);
  TENDRIL_VECTOR(reference_tip_W_m);
  TENDRIL_VECTOR(displacement_desired_m);
  TENDRIL_VECTOR(generalised_force_Nm);
  TENDRIL_VECTOR(tension_desired_base_N);
  TENDRIL_VECTOR(sliding_direction);
  TENDRIL_VECTOR(tension_desired_motor_N);
  TENDRIL_VECTOR(torque_desired_Nm);
  for (std::size_t j = 0; j < a.torque_target_permille.size(); ++j) {
    c.Value(fmt::format("torque_target_permille[{}]", j), a.torque_target_permille[j],
            b.torque_target_permille[j]);
  }
  TENDRIL_VALUE(status);
#undef TENDRIL_VALUE
#undef TENDRIL_VECTOR
  return c.found;
}

namespace {

class LogReplay {
 public:
  LogReplay(const std::string& path, const std::optional<RobotParameters>& robot,
            const std::optional<DaemonParameters>& parameters)
      : path_(path), robot_(robot), parameters_(parameters) {}

  ReplayResult Result() {
    result_.damage = io::StreamLog(
        path_, [this](const io::RunInfo& run) { Take(run); },
        [this](const CycleRecord& record, std::uint64_t offset) { Take(record, offset); },
        [this](const io::StateSnapshot& snapshot) { snapshot_ = snapshot; });
    if (result_.replayed == 0) ThrowWhyNot();
    return std::move(result_);
  }

 private:
  void Take(const io::RunInfo& run) {
    run_ = run;
    result_.version = run.version;
    result_.git_revision = run.git_revision;
  }

  void Take(const CycleRecord& record, std::uint64_t offset) {
    const std::uint64_t cycle = record.input.cycle;
    if (!first_seen_) first_seen_ = cycle;
    if (result_.difference && differs_again_ && !readings_agree_) return;
    const bool resumes = snapshot_ && snapshot_->next_cycle == cycle;
    if (next_ != cycle && (resumes || (cycle == 0 && !controller_)) && !Begin(cycle, resumes)) return;
    if (!controller_ || next_ != cycle) {
      if (!result_.difference && result_.unchecked++ == 0 && next_)
        result_.missing = {.cycle = *next_, .found = cycle, .offset = offset};
      return;
    }
    CycleOutput again;
    controller_->Step(record.input, again);
    next_ = cycle + 1;
    Compare(record, again, offset);
  }

  /// False where the robot is not known.
  bool Begin(std::uint64_t cycle, bool resumes) {
    robot_unknown_ = run_.robot_yaml.empty() && !(robot_ && parameters_);
    if (robot_unknown_) return false;
    if (resumes && (robot_ || parameters_)) {
      throw std::runtime_error(path_ +
                               ": begins in the middle of a run, with a controller's state that belongs "
                               "to its own robot and configuration; leave out --robot and --config");
    }
    controller_ = MakeController(run_, robot_, parameters_);
    if (resumes && !controller_->LoadState(snapshot_->state)) {
      throw std::runtime_error(
          fmt::format("{}: the controller's state in it does not fit this build; replay with the one "
                      "that wrote it, {} ({})",
                      path_, run_.version, run_.git_revision));
    }
    result_.from_snapshot = result_.from_snapshot || resumes;
    if (result_.replayed == 0) result_.first_cycle = cycle;
    next_ = cycle;
    return true;
  }

  void Compare(const CycleRecord& record, const CycleOutput& again, std::uint64_t offset) {
    std::optional<Difference> difference = FirstDifference(record.output, again);
    if (result_.difference) {
      differs_again_ = differs_again_ || difference;
      readings_agree_ = readings_agree_ && !ReadingsDiffer(record.output, again);
      Difference& first = *result_.difference;
      first.agree = differs_again_ ? 0 : first.agree + 1;
      first.readings_agree = readings_agree_ ? first.readings_agree + 1 : 0;
      return;
    }
    ++result_.replayed;
    result_.last_cycle = record.input.cycle;
    if (!difference) return;
    readings_agree_ = ReadingsDiffer(record.output, again);
    result_.difference = std::move(difference);
    result_.difference->cycle = record.input.cycle;
    result_.difference->time_ns = record.input.time_ns;
    result_.difference->offset = offset;
  }

  [[noreturn]] void ThrowWhyNot() const {
    const std::string damaged = result_.damage.empty() ? "" : " (damaged: " + result_.damage + ")";
    if (robot_unknown_) {
      throw std::runtime_error(path_ + ": no run record before the first cycle, so the robot is not known" +
                               damaged + "; give --robot and --config");
    }
    if (!first_seen_ && result_.version.empty() && !damaged.empty()) {
      throw std::runtime_error(path_ + ": not a log that can be replayed" + damaged +
                               "; give one of tendrild --log or tendril demo, or a black box");
    }
    if (!first_seen_) {
      throw std::runtime_error(path_ + ": holds no cycle records" + damaged +
                               "; set lcm.cycle_every_cycles to 1 to log them");
    }
    throw std::runtime_error(
        fmt::format("{}: begins with cycle {} and without the controller's state, so nothing can be "
                    "replayed{}; give a log "
                    "from the start of the program or a black box",
                    path_, *first_seen_, damaged));
  }

  const std::string& path_;
  const std::optional<RobotParameters>& robot_;
  const std::optional<DaemonParameters>& parameters_;
  ReplayResult result_;
  io::RunInfo run_;
  std::optional<io::StateSnapshot> snapshot_;
  std::unique_ptr<control::Controller> controller_;
  std::optional<std::uint64_t> next_;  // the cycle for which the controller has the state
  std::optional<std::uint64_t> first_seen_;
  bool robot_unknown_ = false;
  // Of the cycles after the first difference: one differs; the readings of none do, but of the first's own.
  bool differs_again_ = false, readings_agree_ = false;
};

}  // namespace

ReplayResult ReplayLog(const std::string& path, const std::optional<RobotParameters>& robot,
                       const std::optional<DaemonParameters>& parameters) {
  return LogReplay(path, robot, parameters).Result();
}

}  // namespace tendril::experiment
