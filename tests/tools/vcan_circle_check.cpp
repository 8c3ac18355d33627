// Judges a live run of the circle (LIVE.lcmlog) beside the same run in one process (DEMO.lcmlog,
// summary.json): every commanded tension arrived, and the tip errors agree. Knows the logs, nothing of how
// they were made.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "tendril/io/log.h"

namespace {

using tendril::CycleRecord;
using tendril::Mode;

// The circle: the whole robot bent by pi/3, its bending plane turning at pi/6 rad/s.
constexpr double kBending_rad = std::numbers::pi / 3, kRate_radps = kBending_rad * std::numbers::pi / 6;

int failures = 0;

void Expect(bool good, const std::string& what) {
  fmt::print("{} {}\n", good ? "ok    " : "FAILED", what);
  failures += good ? 0 : 1;
}

struct Rms {
  double sum2 = 0, largest = 0;
  int count = 0;
  void Add(double x) {
    sum2 += x * x;
    largest = std::max(largest, std::abs(x));
    ++count;
  }
  double value() const { return count ? std::sqrt(sum2 / count) : std::numeric_limits<double>::quiet_NaN(); }
};

/// The part of a run in which the reference is on the circle at full speed.
std::vector<std::size_t> OnCircle(const std::vector<CycleRecord>& cycles) {
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < cycles.size(); ++i) {
    const auto& r = cycles[i].output.reference;
    if (cycles[i].output.mode == Mode::kRunning &&
        std::abs(r.position_rad.norm() / kBending_rad - 1) < 0.01 &&
        std::abs(r.velocity_radps.norm() / kRate_radps - 1) < 0.05) {
      found.push_back(i);
    }
  }
  return found;
}

struct Figures {
  Rms estimate_m, tracker_m, tension_N, torque_permille;
  std::size_t cycles = 0;
  int missing = 0;
};

Figures Judge(const std::vector<CycleRecord>& cycles) {
  Figures f;
  const auto on_circle = OnCircle(cycles);
  f.cycles = on_circle.size();
  for (const std::size_t i : on_circle) {
    const auto& [in, out, timing] = cycles[i];
    f.estimate_m.Add((out.tip_estimate_W_m - out.reference_tip_W_m).norm());
    if (in.tracker.valid) f.tracker_m.Add((in.tracker.tip_W_m - out.reference_tip_W_m).norm());
    for (int j = 0; j < in.drives; ++j) {
      const auto tendon = static_cast<std::size_t>(j);
      f.missing += in.drive[tendon].age_cycles != 0;
      f.tension_N.Add(out.tension_measured_N[j] - out.tension_desired_motor_N[j]);
      // A target acts at the SYNC after its cycle and is reported at the one after that.
      if (i + 2 < cycles.size() && cycles[i + 2].input.cycle == in.cycle + 2) {
        f.torque_permille.Add(cycles[i + 2].input.drive[tendon].torque_permille -
                              out.torque_target_permille[tendon]);
      }
    }
  }
  return f;
}

int Run(const std::string& live_path, const std::string& demo_path, const std::string& summary_path) {
  const auto live = tendril::io::ReadLog(live_path), demo = tendril::io::ReadLog(demo_path);
  const auto summary = nlohmann::json::parse(std::ifstream(summary_path));
  Expect(live.damage.empty(), "the log is whole" + live.damage);
  if (live.cycles.size() < 2) throw std::runtime_error("the daemon's log holds no cycles");

  std::uint64_t gaps = 0;
  for (std::size_t i = 1; i < live.cycles.size(); ++i) {
    gaps += live.cycles[i].input.cycle - live.cycles[i - 1].input.cycle - 1;
  }
  const CycleRecord& last = live.cycles.back();
  Expect(gaps <= last.timing.deadline_misses,
         fmt::format("the log has every cycle: {} of {}, {} deadlines missed", live.cycles.size(),
                     last.input.cycle - live.cycles.front().input.cycle + 1, last.timing.deadline_misses));
  Expect(std::none_of(live.cycles.begin(), live.cycles.end(),
                      [](const CycleRecord& r) { return r.output.mode == Mode::kFault; }),
         "no fault");
  Expect(last.output.commands_refused == 0 && last.output.commands_accepted > 1000,
         fmt::format("{} commands accepted, {} refused", last.output.commands_accepted,
                     last.output.commands_refused));

  const Figures a = Judge(live.cycles), b = Judge(demo.cycles);
  Expect(a.cycles > 10000 && b.cycles > 10000,
         fmt::format("cycles on the circle: {} live, {} in one process", a.cycles, b.cycles));
  Expect(a.missing == 0, fmt::format("{} answers of drives missing on the circle", a.missing));
  // Every single target, not the mean: the drive's torque loop and the quantum of its report are the same in
  // both runs.
  Expect(a.torque_permille.largest <= b.torque_permille.largest + 1,
         fmt::format("torque reported less torque commanded, of every cycle: at most {:.0f} permille live, "
                     "{:.0f} in one process",
                     a.torque_permille.largest, b.torque_permille.largest));
  Expect(a.tension_N.value() < 1.25 * b.tension_N.value(),
         fmt::format("tension measured less commanded: {:.4f} N rms live, {:.4f} N in one process",
                     a.tension_N.value(), b.tension_N.value()));
  Expect(std::abs(a.estimate_m.value() - b.estimate_m.value()) < 0.1e-3,
         fmt::format("estimated tip error: {:.3f} mm rms live, {:.3f} mm in one process",
                     1e3 * a.estimate_m.value(), 1e3 * b.estimate_m.value()));
  const double truth_m = summary.at("tip_rms_error_m");
  Expect(
      a.tracker_m.count > 100 && std::abs(a.tracker_m.value() - truth_m) < 0.1e-3,
      fmt::format("tip error: {:.3f} mm rms by the tracker live ({} samples), {:.3f} mm true in one process",
                  1e3 * a.tracker_m.value(), a.tracker_m.count, 1e3 * truth_m));
  return failures ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    fmt::print(stderr, "usage: vcan_circle_check LIVE.lcmlog DEMO.lcmlog SUMMARY.json\n");
    return 2;
  }
  try {
    return Run(argv[1], argv[2], argv[3]);
  } catch (const std::exception& e) {
    fmt::print(stderr, "vcan_circle_check: {}\n", e.what());
    return 1;
  }
}
