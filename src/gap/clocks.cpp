// The tracker's clock against the drives'.
#include "clocks.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "health_signal.h"
#include "median.h"

namespace tendril::gap {
namespace {

constexpr double kBefore_s = 0.015;   // a tip that leads its motors by this much has another clock
constexpr double kRepeated_s = 0.01;  // repetitions agree better than this
constexpr double kSpread_s = 0.015;   // of runs that differ in their delay only
// Correlation of the tip's motion with the nominal robot's above which a shift between them is a time shift;
// friction and damping distort the motion more than they delay it.
constexpr double kAlike = 0.99, kTheSame = 0.995;
constexpr double kUsualLag_s = 0.005;  // of the body behind its motors

/// Delay of the measured tip relative to the nominal robot's tip and to the motors.
struct Late {
  std::optional<Shift> model, motors;
};

Late LateOf(const PreparedRun& run, const sim::BodyMotion& motion) {
  if (!run.tracked() || run.tip_m.rows() == 0 || run.signals.at_rest) return {};
  const int samples = run.samples();
  const Eigen::VectorXd time_s = Eigen::VectorXd::LinSpaced(samples, 0, (samples - 1) * run.signals.step_s);
  Eigen::MatrixXd tip_m = Eigen::MatrixXd::Constant(samples, 3, NAN);
  for (int k = 0; k < run.tracker_s.size(); ++k) {
    const long at = std::clamp<long>(std::lround(run.tracker_s[k] / run.signals.step_s), 0, samples - 1);
    if (run.driven[static_cast<std::size_t>(at)] != 0) tip_m.row(at) = run.tip_m.row(k);
  }
  return {ClockShift(time_s, motion.tip_m, tip_m), ClockShift(time_s, run.signals.motor_angle_rad, tip_m)};
}

}  // namespace

TrackerClocks CompareClocks(const std::vector<PreparedRun>& runs, const std::vector<sim::BodyMotion>& motions,
                            double file_delay_s) {
  std::vector<Late> late;
  for (std::size_t i = 0; i < runs.size(); ++i) late.push_back(LateOf(runs[i], motions[i]));
  const auto alike = [&](std::size_t i, double correlation) {
    return late[i].model && late[i].model->correlation > correlation;
  };

  int before = 0, unlike_original = 0;
  std::vector<double> the_same_s;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    before += late[i].motors && late[i].motors->seconds < file_delay_s - kBefore_s;
    if (alike(i, kTheSame)) the_same_s.push_back(late[i].model->seconds);
    if (!alike(i, kAlike)) continue;
    for (std::size_t k = 0; k < runs.size(); ++k) {
      unlike_original += runs[i].repeat_of == runs[k].name && alike(k, kAlike) &&
                         std::abs(late[i].model->seconds - late[k].model->seconds) > kRepeated_s;
    }
  }
  const auto spread = [](const std::vector<double>& x) {
    const auto [least, most] = std::minmax_element(x.begin(), x.end());
    return x.empty() ? 0.0 : *most - *least;
  };
  TrackerClocks found{std::vector<double>(runs.size(), 0.0), ""};
  if (before == 0 && unlike_original == 0 && spread(the_same_s) < kSpread_s) return found;

  // Where the model is too inaccurate, the motors give the delay to within some milliseconds.
  std::vector<double> lag_s{kUsualLag_s}, moved_s;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (alike(i, kAlike) && late[i].motors) lag_s.push_back(late[i].motors->seconds - late[i].model->seconds);
  }
  const double usual_lag_s = Median(lag_s);
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (!late[i].model && !late[i].motors) continue;
    found.late_s[i] = alike(i, kAlike) || !late[i].motors
                          ? late[i].model->seconds
                          : late[i].motors->seconds - file_delay_s - usual_lag_s;
    moved_s.push_back(-found.late_s[i]);
  }
  const auto [least, most] = std::minmax_element(moved_s.begin(), moved_s.end());
  found.note = fmt::format(
      "the tracker's clock is not the drives' ({}): each run's readings were shifted, by {:.1f} to {:.1f} "
      "ms, and the shift is refitted with every cause; a delay of the tracker, and effects that look like "
      "one, cannot be identified",
      before > 0 ? fmt::format("in {} of {} runs the tip moves before the motors", before, runs.size())
      : unlike_original > 0 ? std::string("repetitions have other delays than their originals")
                            : std::string("runs differ in their delay, and in nothing else"),
      1e3 * *least, 1e3 * *most);
  return found;
}

}  // namespace tendril::gap
