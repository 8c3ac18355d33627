// Evaluator, the targets sent per row of a log, and how well a delay is known then.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "evaluator.h"
#include "squares.h"

namespace tendril::gap {
namespace {

/// The least of a residual over additional delays [s] of up to a tenth of a second: coarse, then by halving.
double LeastOverDelays(const std::function<double(double)>& left) {
  double best_s = 0, least = left(0);
  const auto try_at = [&](double late_s) {
    if (late_s < 0) return;
    if (const double rms = left(late_s); rms < least) best_s = late_s, least = rms;
  };
  double step_s = 0.001;
  for (double late_s = step_s; late_s < 0.1; late_s *= 1.5) try_at(late_s);
  for (step_s = 0.25 * std::max(step_s, best_s); step_s > 5e-5; step_s /= 2) {
    for (const double late_s : {best_s - step_s, best_s + step_s}) try_at(late_s);
  }
  return least;
}

}  // namespace

// A controller's target acts a cycle after it was sent. In a log of every n-th cycle motors seem to respond
// at once, or early; the actual torque shows how many targets were sent per row, if each number is judged at
// the delay that suits it best: a drive that is late is no reason to believe in fewer targets.
void Evaluator::FindTargetsPerRow() {
  constexpr double kFastest_s = 0.9e-3;  // of controllers
  // A number of targets is excluded where another leaves less than this share of its residual. Over thousands
  // of rows chance makes a difference of one per cent; the rest is for drives that are not a first-order lag,
  // whose error the numbers share, but not exactly.
  constexpr double kClearlyLess = 0.8;
  // With the right number the residual is noise and resolution; the file's noise is known to a third.
  constexpr double kAtNoise = 1.3;
  double step_s = std::numeric_limits<double>::infinity();
  std::vector<PreparedRun*> in_doubt;
  for (PreparedRun& run : runs_) {
    // In a slower log a row is not one cycle anyway.
    if (run.signals.at_rest || run.signals.command_delay_s < run.signals.step_s) continue;
    in_doubt.push_back(&run);
    step_s = std::min(step_s, run.signals.step_s);
  }
  if (!has(kC1) || in_doubt.empty() || step_s < 2 * kFastest_s) return;
  const auto take = [&](int commands, double late_s) {
    for (PreparedRun* run : in_doubt) {
      run->signals.commands_a_sample = commands;
      run->signals.command_delay_s = run->signals.step_s / commands + late_s;
    }
  };
  const auto left = [&](int commands) {
    return LeastOverDelays([&](double late_s) {
      take(commands, late_s);
      return TorqueLeft(in_doubt);
    });
  };
  std::vector<double> rms{left(1)};  // [0]: one target per row
  int commands = 1;
  double least = kClearlyLess * rms[0];
  for (int n = 2; step_s / n >= kFastest_s; ++n) {
    rms.push_back(left(n));
    if (rms.back() < least) commands = n, least = rms.back();
  }
  take(commands, 0);
  if (commands > 1) {
    degradations_.push_back(
        fmt::format("according to the actual torque, a row (every {:.3g} ms) holds one of {} targets sent: "
                    "those between are interpolated, and a delay shorter than a row cannot be identified",
                    1e3 * step_s, commands));
  }
  // A log of every cycle leaves no more than the noise. Where more is left, slow targets hide how many they
  // were.
  if (commands == 1 && rms[0] < kAtNoise * TorqueNoise()) return;
  int fewest = commands, most = commands;
  for (int n = 1; n <= static_cast<int>(rms.size()); ++n) {
    if (kClearlyLess * rms[static_cast<std::size_t>(n - 1)] > rms[static_cast<std::size_t>(commands - 1)])
      continue;
    fewest = std::min(fewest, n), most = std::max(most, n);
  }
  if (fewest == most) return;
  // A target acts a cycle after its row, and half of the time that it holds later on average.
  delay_unknown_s_ = 1.5 * step_s * (1.0 / fewest - 1.0 / most);
  degradations_.push_back(
      fmt::format("these logs do not show whether a row (every {:.3g} ms) holds every target or one of {}: a "
                  "delay of the drives is known to {:.2g} ms only; log every cycle",
                  1e3 * step_s, most, 1e3 * delay_unknown_s_));
}

// rms of noise and resolution of the actual torque, of the noisiest drive.
double Evaluator::TorqueNoise() const {
  double most_Nm = 0;
  for (const TendonDriveParameters& tendon : nominal_.actuation->tendons) {
    const DriveParameters& drive = tendon.drive;
    const double permille = std::hypot(drive.actual_torque_noise_permille, 1 / std::sqrt(12.0));
    most_Nm = std::max(most_Nm, 1e-3 * drive.rated_torque_Nm * permille);
  }
  return most_Nm;
}

// rms of the actual torque that the targets do not explain, over all runs.
double Evaluator::TorqueLeft(const std::vector<PreparedRun*>& runs) const {
  const sim::Replay replay(nominal_);
  Squares squares;
  for (const PreparedRun* run : runs) {
    const Eigen::MatrixXd off = replay.ActualTorque(run->signals) - run->signals.torque_actual_Nm;
    for (Eigen::Index j = 0; j < off.cols(); ++j) {
      Eigen::VectorXd of_tendon = off.col(j);
      run->TakeOut(run->torque_dropouts, static_cast<int>(j), of_tendon);
      run->TakeOut(run->target_dropouts, static_cast<int>(j), of_tendon);
      for (Eigen::Index i = 0; i < of_tendon.size(); ++i) {
        if (run->valid[static_cast<std::size_t>(i)] && std::isfinite(of_tendon[i])) squares.Add(of_tendon[i]);
      }
    }
  }
  return squares.rms();
}

}  // namespace tendril::gap
