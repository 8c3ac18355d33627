// From repeated runs to whether they repeat.
#include "repeatability.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "depends_on.h"
#include "evaluator.h"
#include "locate.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

// Times the sensors' noise. Friction that is another one by a few per cent each time makes a usual robot
// differ by some: more is a robot that was changed, or does something else. What follows a state is no
// scatter of friction, and counts from where it may hide a cause.
constexpr double kFar = 5, kFarOfLaw = 2;
constexpr double kWindow_s = 0.02;  // at least, of what is compared with states
// Within it what drives a motor off its way may last.
constexpr double kBlock_s = 0.5;
constexpr int kBlockStates = 5;

/// Means of a signal on the grid (S) over windows of so many samples, those in `at`.
Eigen::VectorXd On(const std::vector<int>& at, int width, const Eigen::Ref<const Eigen::VectorXd>& grid) {
  Eigen::VectorXd mean(static_cast<Eigen::Index>(at.size()));
  for (std::size_t k = 0; k < at.size(); ++k)
    mean[static_cast<Eigen::Index>(k)] = grid.segment(at[k] * width, width).mean();
  return mean;
}

/// How far the tip is bent aside, on the grid.
Eigen::VectorXd TipAside(const PreparedRun& run) {
  Eigen::VectorXd aside(run.samples());
  Eigen::Index k = 0;
  for (int i = 0; i < aside.size(); ++i) {
    while (k + 1 < run.tracker_s.size() && run.tracker_s[k + 1] <= i * run.signals.step_s) ++k;
    aside[i] = run.tip_m.row(k).head<2>().norm();
  }
  return aside;
}

/// One group as it shows in a channel, over windows of at least kWindow_s that all its runs have.
class Shown {
 public:
  Shown(const Evaluator& evaluator, int channel, const std::vector<int>& group)
      : evaluator_(evaluator), channel_(channel), group_(group) {
    const PreparedRun& run = evaluator.runs()[group.front()];
    own_ = WindowSamples(run, evaluator.channels()[channel]);
    joined_ = std::max(1, static_cast<int>(std::lround(kWindow_s / (own_ * run.signals.step_s))));
    Find();
  }

  Repetitions Told() const {
    const auto n = static_cast<Eigen::Index>(group_.size());
    Repetitions r;
    const auto windows = static_cast<Eigen::Index>(at_.size());
    const int width = own_ * joined_;
    const PreparedRun& first = evaluator_.runs()[group_.front()];
    r.window_s = width * first.signals.step_s;
    r.block.resize(windows);
    r.off.resize(windows, n);
    for (Eigen::Index w = 0; w < windows; ++w) {
      const int at = at_[static_cast<std::size_t>(w)];
      r.block[w] = first.signals.at_rest ? at / kBlockStates : static_cast<int>(at * r.window_s / kBlock_s);
      double variance = 0;
      for (Eigen::Index i = 0; i < n; ++i) {
        const int run = group_[static_cast<std::size_t>(i)];
        r.off(w, i) = evaluator_.AtNominal()[run][channel_].segment(at * joined_, joined_).mean();
        variance += evaluator_.Variance()[run][channel_].segment(at * joined_, joined_).mean();
      }
      r.off.row(w).array() -= r.off.row(w).mean();
      r.off.row(w) /= std::sqrt(variance / static_cast<double>(n));
    }
    for (const int j : Motors()) r.motors.push_back(MotorOf(j, width));
    AddConditions(width, r);
    return r;
  }

 private:
  /// Motors that a channel may follow: its own, or of a tip all.
  std::vector<int> Motors() const {
    const Channel& channel = evaluator_.channels()[channel_];
    std::vector<int> motors;
    for (int j = 0; j < evaluator_.nominal().body.tendons(); ++j) {
      if (channel.cut == sim::Cut::kShape || channel.index == j) motors.push_back(j);
    }
    return motors;
  }

  void Find() {
    Eigen::Index windows = evaluator_.Variance()[group_.front()][channel_].size() / joined_;
    for (const int run : group_)
      windows = std::min(windows, evaluator_.Variance()[run][channel_].size() / joined_);
    for (int w = 0; w < windows; ++w) {
      const bool all = std::all_of(group_.begin(), group_.end(), [&](int run) {
        return evaluator_.Variance()[run][channel_].segment(w * joined_, joined_).array().isFinite().all() &&
               MotorsKnown(evaluator_.runs()[run], w);
      });
      if (all) at_.push_back(w);
    }
  }

  bool MotorsKnown(const PreparedRun& run, int w) const {
    const int from = w * joined_ * own_, to = from + joined_ * own_;
    const std::vector<int> motors = Motors();
    return std::none_of(run.motor_holes.begin(), run.motor_holes.end(), [&](const Hole& hole) {
      return hole.from < to && from < hole.to &&
             std::find(motors.begin(), motors.end(), hole.tendon) != motors.end();
    });
  }

  RepeatedMotor MotorOf(int j, int width) const {
    RepeatedMotor motor;
    motor.name = fmt::format("motor {}", j + 1);
    motor.gear_ratio = evaluator_.nominal().actuation->tendons[static_cast<std::size_t>(j)].gear.ratio;
    motor.angle_rad.resize(static_cast<Eigen::Index>(at_.size()), static_cast<Eigen::Index>(group_.size()));
    motor.velocity_radps = motor.angle_rad;
    for (std::size_t i = 0; i < group_.size(); ++i) {
      const sim::ReplaySignals& s = evaluator_.runs()[group_[i]].signals;
      motor.angle_rad.col(static_cast<Eigen::Index>(i)) = On(at_, width, s.motor_angle_rad.col(j));
      motor.velocity_radps.col(static_cast<Eigen::Index>(i)) = On(at_, width, s.motor_velocity_radps.col(j));
    }
    return motor;
  }

  /// As the first run has them: what scatters hardly moves a state from bin to bin.
  void AddConditions(int width, Repetitions& r) const {
    const PreparedRun& run = evaluator_.runs()[group_.front()];
    const Channel& channel = evaluator_.channels()[channel_];
    const sim::ReplaySignals& s = run.signals;
    const auto add = [&](const std::string& name, const char* unit, const Eigen::VectorXd& grid) {
      r.conditions.push_back({name, unit, On(at_, width, grid)});
    };
    const int j = channel.cut == sim::Cut::kShape ? -1 : channel.index;
    const auto of = [&](const Eigen::MatrixXd& all) {
      return j >= 0 ? Eigen::VectorXd(all.col(j)) : Eigen::VectorXd(all.rowwise().sum());
    };
    const std::string which = j >= 0 ? fmt::format(" {}", j + 1) : "s together";
    if (s.tension_N.cols() > 0) add("tension" + which, "N", of(s.tension_N));
    if (j >= 0) {
      add("the angle of motor" + which, "rad", of(s.motor_angle_rad));
      add("the speed of motor" + which, "rad/s", of(s.motor_velocity_radps));
    }
    add("time in the run", "s", Eigen::VectorXd::LinSpaced(run.samples(), 0, (run.samples() - 1) * s.step_s));
    if (run.tracked()) add("how far the tip is aside", "m", TipAside(run));
  }

  const Evaluator& evaluator_;
  const int channel_;
  const std::vector<int>& group_;
  int own_ = 1, joined_ = 1;  // samples of a window of the channel, and how many of these make one here
  std::vector<int> at_;       // windows that all runs have
};

double DeltaOf(const Channel& channel, const RepeatabilityOptions& options) {
  if (channel.quantity == Quantity::kTension) return options.delta_N;
  return channel.quantity == Quantity::kTipPosition ? options.delta_m : 0;
}

/// "does not repeat at C2 (tension, tendon:2): ..."
std::string DoesNotRepeat(const Repeatability& r) {
  const std::string how = r.depends_on.empty() ? "on no state that was tried"
                                               : fmt::format("{}on {} (p = {:.2g})", r.law ? "" : "in size ",
                                                             r.depends_on, r.p_value);
  return fmt::format(
      "does not repeat at {} ({}, {}): runs of the same commands differ by {:.2g} sigma more than the "
      "sensors "
      "explain, which depends {}",
      sim::CutName(r.cut), r.quantity, r.where, r.sigma, how);
}

}  // namespace

std::vector<std::vector<int>> RepeatedRuns(const Evaluator& evaluator) {
  const auto& runs = evaluator.runs();
  std::vector<std::vector<int>> groups;
  for (int i = 0; i < static_cast<int>(runs.size()); ++i) {
    std::vector<int> group{i};
    for (int k = 0; k < static_cast<int>(runs.size()); ++k) {
      if (k != i && runs[k].repeat_of == runs[i].name) group.push_back(k);
    }
    if (group.size() > 1) groups.push_back(std::move(group));
  }
  return groups;
}

Repeated RepeatedIn(const Evaluator& evaluator, int channel) {
  Repeated sum;
  for (const auto& group : RepeatedRuns(evaluator)) {
    for (std::size_t k = 1; k < group.size(); ++k) {
      const auto &a = evaluator.AtNominal()[group[0]][channel], &b = evaluator.AtNominal()[group[k]][channel];
      const auto &va = evaluator.Variance()[group[0]][channel], &vb = evaluator.Variance()[group[k]][channel];
      for (Eigen::Index w = 0; w < std::min(a.size(), b.size()); ++w) {
        if (!std::isfinite(va[w]) || !std::isfinite(vb[w])) continue;
        const double square = std::pow(a[w] - b[w], 2), noise = va[w] + vb[w];
        sum.square += 0.5 * square, sum.noise += 0.5 * noise, sum.ratio += square / noise;
        ++sum.windows;
      }
    }
  }
  if (sum.windows > 0) sum.square /= sum.windows, sum.noise /= sum.windows, sum.ratio /= sum.windows;
  return sum;
}

std::optional<Repeatability> FindRepeatability(const Evaluator& evaluator,
                                               const RepeatabilityOptions& options) {
  const auto groups = RepeatedRuns(evaluator);
  const int channels = static_cast<int>(evaluator.channels().size());
  std::vector<Repeated> differing(static_cast<std::size_t>(channels));
  std::vector<std::vector<Repetitions>> shown(static_cast<std::size_t>(channels));
  int worst = -1;
  for (int c = 0; c < channels; ++c) {
    const Repeated& d = differing[static_cast<std::size_t>(c)] = RepeatedIn(evaluator, c);
    const double beyond = std::sqrt(std::max(0.0, d.square - d.noise));
    if (!d.known() || d.ratio <= kFarOfLaw * kFarOfLaw ||
        beyond <= DeltaOf(evaluator.channels()[static_cast<std::size_t>(c)], options))
      continue;
    if (worst < 0 || d.ratio > differing[static_cast<std::size_t>(worst)].ratio) worst = c;
    for (const auto& group : groups) {
      Repetitions told = Shown(evaluator, c, group).Told();
      if (told.block.size() > 0) shown[static_cast<std::size_t>(c)].push_back(std::move(told));
    }
  }
  if (worst < 0) return std::nullopt;
  Repeatability r;
  const auto depends = DependsOn(shown, options.seed);
  if (depends && depends->second.law) worst = depends->first;
  if (depends && depends->first == worst) {
    r.depends_on = depends->second.on;
    r.p_value = depends->second.p_value;
    r.law = depends->second.law;
  }
  const Repeated& d = differing[static_cast<std::size_t>(worst)];
  if (!r.law && d.ratio <= kFar * kFar) return std::nullopt;
  const Channel& channel = evaluator.channels()[static_cast<std::size_t>(worst)];
  r.cut = channel.cut;
  r.where = PlaceOf(channel, evaluator);
  r.quantity = NameOf(channel.quantity);
  r.unit = channel.unit;
  r.rms = std::sqrt(d.square);
  r.floor = std::sqrt(d.noise);
  r.sigma = std::sqrt(std::max(0.0, d.ratio - 1));
  return r;
}

double ChanceOf(const Repeatability& r) {
  if (!r.law) return 0.5;  // a robot that was changed, pushed, or has an effect: nobody knows which
  // The most that a p-value leaves for chance, at even odds before (Sellke, Bayarri, Berger 2001).
  const double p = std::min(r.p_value, std::exp(-1.0));
  const double bayes = -std::exp(1.0) * p * std::log(p);
  return bayes / (1 + bayes);
}

std::string Unrepeated(const Repeatability& r) {
  return fmt::format(
      "The robot {}. {}", DoesNotRepeat(r),
      r.law ? "No effect of the library that was tried makes runs differ so: its model lacks one that does."
            : "Whether the model has a gap beneath that these logs do not tell; if anything was changed or "
              "touched between the runs, they are no repetitions (repeat_of: none in runs.yaml).");
}

std::string ButUnrepeated(const std::optional<Repeatability>& r) {
  if (!r) return "";
  return fmt::format(" But the robot {}{}", DoesNotRepeat(*r),
                     r->law ? "." : "; if it was changed between them, they are no floor.");
}

}  // namespace tendril::gap
