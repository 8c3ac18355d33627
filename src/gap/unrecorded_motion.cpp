// Evaluator, what lost samples and the time before the first sample do to the rest of a run.
#include <fmt/core.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "evaluator.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

/// The run as if the spool of tendon j had overshot and returned by the time the body has settled, whenever
/// it moved unseen: friction in its pulleys then acts in the opposite direction.
PreparedRun SlidOtherwise(PreparedRun run, const RobotParameters& robot, int j, int way) {
  constexpr double kSurely = 2.2;  // reversing takes twice the presliding
  const auto& drive = robot.actuation->tendons[static_cast<std::size_t>(j)];
  // With a fixed body a tendon slides by half of its spool's motion.
  const double far_rad = way * kSurely * 2 * drive.transmission.presliding_m / drive.SpoolTravelPerMotorRad();
  const double step_s = run.signals.step_s;
  for (const Dropout& dropout : run.moved_unseen) {
    if (dropout.tendon >= 0 && dropout.tendon != j) continue;
    const int settled =
        std::min(run.samples(), dropout.to + static_cast<int>(std::lround(kBodySettles_s / step_s)));
    const double half = 0.5 * (settled - dropout.from), speed_radps = far_rad / (half * step_s);
    for (int i = dropout.from; i < settled; ++i) {
      const double gone = (i + 0.5 - dropout.from) / half;
      run.signals.motor_angle_rad(i, j) += far_rad * std::min(gone, 2 - gone);
      run.signals.motor_velocity_radps(i, j) += gone < 1 ? speed_radps : -speed_radps;
    }
  }
  return run;
}

/// A different unseen motion of a run, instead of a straight line.
enum class Unseen { kFirstHalf, kSecondHalf, kAsBefore, kAsAfter };

/// Signal x at sample i of a gap between `before` and `after`: moved within one half of it, or continued with
/// the motion before or after, mirrored at that end and tilted to meet the other.
double Otherwise(const Eigen::Ref<const Eigen::VectorXd>& x, int i, int before, int after, Unseen unseen) {
  const auto last = static_cast<int>(x.size()) - 1;
  const double done = static_cast<double>(i - before) / (after - before);
  const auto as_before = [&](int k) { return 2 * x[before] - x[std::max(0, 2 * before - k)]; };
  const auto as_after = [&](int k) { return 2 * x[after] - x[std::min(last, 2 * after - k)]; };
  switch (unseen) {
    case Unseen::kFirstHalf:
      return x[before] + std::min(1.0, 2 * done) * (x[after] - x[before]);
    case Unseen::kSecondHalf:
      return x[before] + std::max(0.0, 2 * done - 1) * (x[after] - x[before]);
    case Unseen::kAsBefore:
      return as_before(i) + done * (x[after] - as_before(after));
    case Unseen::kAsAfter:
      return as_after(i) + (1 - done) * (x[before] - as_after(before));
  }
  return x[i];
}

/// The run with different motions in all gaps, so that the body swings differently afterwards.
PreparedRun MovedOtherwise(const PreparedRun& read, Unseen unseen) {
  PreparedRun run = read;
  const sim::ReplaySignals& was = read.signals;
  for (const Dropout& dropout : run.moved_unseen) {
    const int before = std::max(0, dropout.from - 1), after = std::min(run.samples() - 1, dropout.to);
    const int first = std::max(0, dropout.tendon);
    const int last = dropout.tendon < 0 ? static_cast<int>(was.motor_angle_rad.cols()) : dropout.tendon + 1;
    const auto move = [&](const Eigen::MatrixXd& signal, Eigen::MatrixXd& moved, int j) {
      if (signal.cols() <= j) return;
      const double least = signal.col(j).minCoeff(),
                   most = signal.col(j).maxCoeff();  // range of the signal in the run
      for (int i = dropout.from; i < dropout.to; ++i)
        moved(i, j) = std::clamp(Otherwise(signal.col(j), i, before, after, unseen), least, most);
    };
    for (int j = first; j < last; ++j) {
      move(was.motor_angle_rad, run.signals.motor_angle_rad, j);
      for (int i = dropout.from; i < dropout.to; ++i) {
        const int next = std::min(i + 1, after);
        run.signals.motor_velocity_radps(i, j) =
            (run.signals.motor_angle_rad(next, j) - run.signals.motor_angle_rad(i, j)) / was.step_s;
      }
      if (dropout.tendon >= 0) continue;
      move(was.torque_actual_Nm, run.signals.torque_actual_Nm, j);
      move(was.tension_N, run.signals.tension_N, j);
    }
  }
  return run;
}

}  // namespace

// After lost samples, and where a run begins in motion, the body swings from an unknown position, and
// friction may act in either direction until each tendon has slid over its presliding and back; meanwhile it
// moves the body, which slides the other tendons. The duration depends on the motion, so every alternative
// unseen motion is simulated, and windows that it clearly changes are masked.
void Evaluator::MaskAfterUnrecordedMotion(int threads) {
  constexpr double kClearlyChanged = 0.5;  // relative to the noise
  const int runs = static_cast<int>(runs_.size()), tendons = nominal_.body.tendons();
  struct Trial {
    int run, what;  // tendon, or M: the whole motion
    std::function<PreparedRun()> otherwise;
    std::vector<Eigen::VectorXd> residuals{};
    std::string trouble{};
  };
  std::vector<Trial> tried;
  for (int i = 0; i < runs; ++i) {
    const PreparedRun& run = runs_[i];
    const auto& dropouts = run.moved_unseen;
    if (dropouts.empty()) continue;
    for (int j = 0; j < tendons; ++j) {
      const auto slid = [&](const Dropout& dropout) { return dropout.tendon < 0 || dropout.tendon == j; };
      if (std::none_of(dropouts.begin(), dropouts.end(), slid)) continue;
      if (nominal_.actuation->tendons[static_cast<std::size_t>(j)].SpoolTravelPerMotorRad() <= 0) continue;
      for (const int way : {-1, 1})
        tried.push_back({i, j, [&run, this, j, way] { return SlidOtherwise(run, nominal_, j, way); }});
    }
    for (const Unseen unseen : {Unseen::kFirstHalf, Unseen::kSecondHalf, Unseen::kAsBefore, Unseen::kAsAfter})
      tried.push_back({i, tendons, [&run, unseen] { return MovedOtherwise(run, unseen); }});
  }
  ParallelFor(static_cast<int>(tried.size()), threads, [&](int k) {
    Trial& trial = tried[static_cast<std::size_t>(k)];
    try {
      const PreparedRun moved = trial.otherwise();
      trial.residuals =
          ResidualsOf(ReplayRun(nominal_, moved, kC2 | kC3 | kBody, nullptr), moved, kC2 | kC3 | kBody);
    } catch (const std::runtime_error& error) {
      trial.trouble = error.what();
    }
  });
  double forgotten_s = 0;
  std::string names;
  for (int i = 0; i < runs; ++i) {
    double longest_s = 0;
    for (std::size_t c = 0; c < channels_.size(); ++c) {
      auto &r = nominal_residuals_[i][c], &variance = variance_[i][c];
      Eigen::MatrixXd open = Eigen::MatrixXd::Zero(r.size(), tendons + 1);
      for (const Trial& trial : tried) {
        if (trial.run != i) continue;
        if (!trial.trouble.empty()) {
          throw RunError(static_cast<std::size_t>(i),
                         fmt::format("{}: alternative motion while nothing was recorded: {}", runs_[i].name,
                                     trial.trouble));
        }
        if (trial.residuals[c].size() != r.size()) continue;
        open.col(trial.what) = open.col(trial.what).cwiseMax((trial.residuals[c] - r).cwiseAbs());
      }
      int windows = 0;
      for (int w = 0; w < r.size(); ++w) {
        if (!std::isfinite(variance[w]) || !(open.row(w).sum() > kClearlyChanged * std::sqrt(variance[w])))
          continue;
        variance[w] = std::numeric_limits<double>::infinity();
        r[w] = 0;
        ++windows;
      }
      longest_s = std::max(longest_s, windows * window_s(i, static_cast<int>(c)));
    }
    if (longest_s == 0) continue;
    forgotten_s += longest_s;
    names += (names.empty() ? "" : ", ") + runs_[i].name;
  }
  if (!names.empty()) {
    degradations_.push_back(
        fmt::format("after lost samples, and where a run begins in motion, the body's position is unknown "
                    "and pulley friction may act in either direction until the tendons have slid: up to "
                    "{:.3g} s are masked where that matters ({})",
                    forgotten_s, names));
  }
}

}  // namespace tendril::gap
