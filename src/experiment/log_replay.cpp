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

ReplayResult ReplayLog(const std::string& path, const std::optional<RobotParameters>& robot,
                       const std::optional<DaemonParameters>& parameters) {
  ReplayResult result;
  io::RunInfo run;
  std::optional<io::StateSnapshot> snapshot;
  std::unique_ptr<control::Controller> controller;
  std::optional<std::uint64_t> next;  // the cycle for which the controller has the state
  std::optional<std::uint64_t> first_seen;
  bool differs_again = false;  // after the first difference
  bool robot_unknown = false;

  result.damage = io::StreamLog(
      path,
      [&](const io::RunInfo& r) {
        run = r;
        result.version = r.version;
        result.git_revision = r.git_revision;
      },
      [&](const CycleRecord& record, std::uint64_t offset) {
        const std::uint64_t cycle = record.input.cycle;
        if (!first_seen) first_seen = cycle;
        if (result.difference && differs_again && !result.difference->in_readings) return;
        const bool resumes = snapshot && snapshot->next_cycle == cycle;
        if (next != cycle && (resumes || (cycle == 0 && !controller))) {
          robot_unknown = run.robot_yaml.empty() && !(robot && parameters);
          if (robot_unknown) return;
          if (resumes && (robot || parameters)) {
            throw std::runtime_error(
                path +
                ": begins in the middle of a run, with a controller's state that belongs "
                "to its own robot and configuration; leave out --robot and --config");
          }
          controller = MakeController(run, robot, parameters);
          if (resumes && !controller->LoadState(snapshot->state)) {
            throw std::runtime_error(
                fmt::format("{}: the controller's state in it does not fit this build; replay with the one "
                            "that wrote it, "
                            "{} ({})",
                            path, run.version, run.git_revision));
          }
          result.from_snapshot = result.from_snapshot || resumes;
          if (result.replayed == 0) result.first_cycle = cycle;
          next = cycle;
        }
        if (!controller || next != cycle) {
          if (!result.difference && result.unchecked++ == 0 && next)
            result.missing = {.cycle = *next, .found = cycle, .offset = offset};
          return;
        }
        CycleOutput again;
        controller->Step(record.input, again);
        next = cycle + 1;
        std::optional<Difference> difference = FirstDifference(record.output, again);
        if (result.difference) {
          Difference& first = *result.difference;
          differs_again = differs_again || difference;
          first.agree = differs_again ? 0 : first.agree + 1;
          first.in_readings = first.in_readings && !ReadingsDiffer(record.output, again);
          first.readings_agree = first.in_readings ? first.readings_agree + 1 : 0;
          return;
        }
        ++result.replayed;
        result.last_cycle = cycle;
        if (!difference) return;
        result.difference = std::move(difference);
        result.difference->cycle = cycle;
        result.difference->time_ns = record.input.time_ns;
        result.difference->offset = offset;
        result.difference->in_readings = ReadingsDiffer(record.output, again);
      },
      [&](const io::StateSnapshot& s) { snapshot = s; });
  if (result.replayed > 0) return result;
  const std::string damaged = result.damage.empty() ? "" : " (damaged: " + result.damage + ")";
  if (robot_unknown) {
    throw std::runtime_error(path + ": no run record before the first cycle, so the robot is not known" +
                             damaged + "; give --robot and --config");
  }
  if (!first_seen && result.version.empty() && !damaged.empty()) {
    throw std::runtime_error(path + ": not a log that can be replayed" + damaged +
                             "; give one of tendrild --log or tendril demo, or a black box");
  }
  if (!first_seen) {
    throw std::runtime_error(path + ": holds no cycle records" + damaged +
                             "; set lcm.cycle_every_cycles to 1 to log them");
  }
  throw std::runtime_error(fmt::format(
      "{}: begins with cycle {} and without the controller's state, so nothing can be replayed{}; give a log "
      "from the start of the program or a black box",
      path, *first_seen, damaged));
}

}  // namespace tendril::experiment
