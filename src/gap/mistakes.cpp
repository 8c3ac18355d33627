// One list of mistakes, one measure of how much of the gap each leaves.
#include "mistakes.h"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "health_signal.h"
#include "median.h"
#include "parallel.h"

namespace tendril::gap {
namespace {

constexpr double kLarge = 8;      // floors, or times what other runs leave: effects are rarely larger
constexpr double kTakenAway = 4;  // times smaller is a gap whose reason was this mistake
constexpr std::size_t kRuns = 3;  // that each is tried on
constexpr const char* kAxes = "xyz";

using Undo = std::function<void(Run&)>;

struct Mistake {
  std::string with;  // what would make it right
  Undo undo;
  std::vector<Mistake> finer{};  // of other sizes about this one's
};

void Negate(Eigen::MatrixXd& values, Eigen::Index column) {
  if (column < values.cols()) values.col(column) *= -1;
}

void Exchange(Eigen::MatrixXd& values, Eigen::Index a, Eigen::Index b) {
  if (std::max(a, b) < values.cols()) values.col(a).swap(values.col(b));
}

/// The tracker's frame turned about the base's axis, positions and orientations.
void Turn(Run& run, const Eigen::AngleAxisd& by) {
  if (run.tip_m.cols() != 3) return;
  const Eigen::Matrix3d R = by.toRotationMatrix();
  run.tip_m = (run.tip_m * R.transpose()).eval();
  for (Eigen::Index i = 0; i < run.tip_quaternion.rows() && run.tip_quaternion.cols() == 4; ++i) {
    const Eigen::Vector4d w = run.tip_quaternion.row(i).transpose();
    const Eigen::Quaterniond q = Eigen::Quaterniond(by) * Eigen::Quaterniond(w[0], w[1], w[2], w[3]);
    run.tip_quaternion.row(i) << q.w(), q.x(), q.y(), q.z();
  }
}

/// The cells' readings, each as it came so much later.
void Advance(Run& run, double late_s) {
  const Eigen::Index rows = run.time_s.size();
  const auto by = static_cast<Eigen::Index>(std::lround(late_s / UsualStep(run)));
  if (by < 1 || by >= rows || run.tension_N.rows() != rows) return;
  run.tension_N.topRows(rows - by) = run.tension_N.bottomRows(rows - by).eval();
  run.tension_N.bottomRows(by).setConstant(std::numeric_limits<double>::quiet_NaN());
}

/// The cells' readings before a first-order low-pass filter: its slopes are told from +-kSlope_s.
void Unfilter(Run& run, double time_constant_s) {
  constexpr double kSlope_s = 0.005;
  const Eigen::Index rows = run.time_s.size();
  const auto half = std::max<Eigen::Index>(1, std::lround(kSlope_s / UsualStep(run)));
  if (rows <= 2 * half || run.tension_N.rows() != rows) return;
  const Eigen::MatrixXd read = run.tension_N;
  for (Eigen::Index i = 0; i < rows; ++i) {
    const Eigen::Index a = std::clamp<Eigen::Index>(i - half, 0, rows - 1 - 2 * half);
    const Eigen::ArrayXd t =
        run.time_s.segment(a, 2 * half + 1).array() - run.time_s.segment(a, 2 * half + 1).mean();
    const Eigen::RowVectorXd slope =
        (read.middleRows(a, 2 * half + 1).array().colwise() * t).colwise().sum() / t.square().sum();
    run.tension_N.row(i) = read.row(i) + time_constant_s * slope;
  }
}

/// What may go wrong in recording one run as well as all of them.
std::vector<Mistake> MistakesOfReading(const DataSet& set, bool cells, bool tracked) {
  std::vector<Mistake> all;
  const int tendons = set.robot.body.tendons();
  for (int j = 0; j < tendons; ++j) {
    all.push_back({fmt::format("the sign of motor position {} turned round", j + 1),
                   [j](Run& run) { Negate(run.motor_position_rad, j); }});
    for (int k = j + 1; k < tendons; ++k) {
      const auto exchanged = [&](const char* what, std::vector<Eigen::MatrixXd Run::*> columns) {
        all.push_back({fmt::format("{} {} and {} exchanged", what, j + 1, k + 1), [=](Run& run) {
                         for (const auto values : columns) Exchange(run.*values, j, k);
                       }});
      };
      exchanged("all columns of tendons",
                {&Run::torque_target_Nm, &Run::torque_actual_Nm, &Run::motor_position_rad, &Run::tension_N});
      exchanged("the motor positions", {&Run::motor_position_rad});
      if (cells) exchanged("the load cells", {&Run::tension_N});
    }
  }
  const auto motors_in = [&](const char* unit, double rad) {
    all.push_back({fmt::format("the motor positions taken as {}", unit),
                   [rad](Run& run) { run.motor_position_rad *= rad; }});
  };
  motors_in("degrees", std::numbers::pi / 180);
  motors_in("turns", 2 * std::numbers::pi);
  if (const int counts = set.robot.actuation->tendons.front().drive.encoder_counts_per_turn; counts > 0)
    motors_in("encoder counts", 2 * std::numbers::pi / counts);
  // In steps of a half, and about each in steps of a twentieth.
  const auto of_all_sizes = [&](auto&& of_size) {
    for (double ms = 5; ms < 150; ms *= 1.5) {
      Mistake mistake = of_size(ms);
      for (double finer_ms = ms / 1.25; finer_ms < 1.26 * ms; finer_ms *= 1.05)
        mistake.finer.push_back(of_size(finer_ms));
      all.push_back(std::move(mistake));
    }
  };
  if (cells) {
    of_all_sizes([](double ms) {
      return Mistake{fmt::format("the load cells' readings taken {:.2g} ms earlier", ms),
                     [ms](Run& run) { Advance(run, 1e-3 * ms); }};
    });
    of_all_sizes([](double ms) {
      return Mistake{fmt::format("a low-pass filter of {:.2g} ms taken off the load cells' readings", ms),
                     [ms](Run& run) { Unfilter(run, 1e-3 * ms); }};
    });
  }
  if (!tracked || set.fit_frame) return all;
  for (int a = 0; a < 3; ++a) {
    all.push_back(
        {fmt::format("the sign of tip {} turned round", kAxes[a]), [a](Run& run) { Negate(run.tip_m, a); }});
    for (int b = a + 1; b < 3; ++b) {
      all.push_back({fmt::format("tip {} and {} exchanged", kAxes[a], kAxes[b]),
                     [a, b](Run& run) { Exchange(run.tip_m, a, b); }});
    }
    for (const int quarters : {1, 2, 3}) {
      const Eigen::AngleAxisd by(quarters * std::numbers::pi / 2, Eigen::Vector3d::Unit(a));
      all.push_back(
          {fmt::format("the tracker's frame turned by {} degrees about {}", 90 * quarters, kAxes[a]),
           [by](Run& run) { Turn(run, by); }});
    }
  }
  return all;
}

/// And in what is said of all of them.
std::vector<Mistake> AllMistakes(const DataSet& set, bool cells, bool tracked) {
  std::vector<Mistake> all = MistakesOfReading(set, cells, tracked);
  if (cells) {
    const bool motors = set.runs.front().load_cell == LoadCellPlace::kMotorSide;
    all.push_back({fmt::format("the load cells on the {} side (load_cell in runs.yaml)",
                               motors ? "robot's" : "motors'"),
                   [](Run& run) {
                     run.load_cell = run.load_cell == LoadCellPlace::kMotorSide ? LoadCellPlace::kRobotSide
                                                                                : LoadCellPlace::kMotorSide;
                   }});
  }
  return all;
}

using Kind = std::pair<sim::Cut, Channel::Quantity>;

struct Squares {
  double sum = 0, count = 0;
  double rms() const { return std::sqrt(sum / count); }
};

/// What the nominal robot leaves of one run, by kinds of channels that it has.
std::map<Kind, Squares> LeftOf(const Evaluator& evaluator, std::size_t run) {
  std::map<Kind, Squares> left;
  for (std::size_t c = 0; c < evaluator.channels().size(); ++c) {
    Squares& squares = left[{evaluator.channels()[c].cut, evaluator.channels()[c].quantity}];
    const auto& variance = evaluator.Variance()[run][c];
    for (Eigen::Index w = 0; w < variance.size(); ++w) {
      if (!std::isfinite(variance[w])) continue;
      squares.sum += std::pow(evaluator.AtNominal()[run][c][w], 2);
      squares.count += 1;
    }
  }
  std::erase_if(left, [](const auto& of_kind) { return !(of_kind.second.sum > 0); });
  return left;
}

/// Mean over the kinds of channels of what the nominal robot leaves of all runs, in floors.
double Misfit(const Evaluator& evaluator, const std::map<Kind, double>& floors) {
  std::map<Kind, Squares> left;
  for (std::size_t i = 0; i < evaluator.runs().size(); ++i) {
    for (const auto& [kind, squares] : LeftOf(evaluator, i)) {
      left[kind].sum += squares.sum;
      left[kind].count += squares.count;
    }
  }
  double total = 0;
  int kinds = 0;
  for (const auto& [kind, floor] : floors) {
    const auto found = left.find(kind);
    if (found == left.end() || !(floor > 0)) continue;
    // What noise leaves anyway is not to be told from nothing.
    total += std::hypot(1.0, found->second.rms() / floor);
    ++kinds;
  }
  return kinds > 0 ? total / kinds : std::numeric_limits<double>::infinity();
}

/// The largest of what the nominal robot leaves of one run, over what is usual.
double Worst(const std::map<Kind, Squares>& left, const std::map<Kind, double>& usual) {
  double worst = 0;
  for (const auto& [kind, squares] : left) {
    const auto found = usual.find(kind);
    if (found != usual.end()) worst = std::max(worst, squares.rms() / found->second);
  }
  return worst;
}

/// Words of the mistake that, once undone, leaves least, if that is little of what is left without; `left`
/// says how much is.
std::string WhatMakesItRight(const std::vector<Mistake>& mistakes,
                             const std::function<double(const Undo&)>& left, int threads) {
  constexpr std::size_t kRefined = 3;
  using Tried = std::pair<double, const Mistake*>;
  const auto try_all = [&](const std::vector<const Mistake*>& some) {
    std::vector<Tried> tried(some.size());
    ParallelFor(static_cast<int>(some.size()), threads, [&](int m) {
      const Mistake* mistake = some[static_cast<std::size_t>(m)];
      tried[static_cast<std::size_t>(m)] = {left(mistake->undo), mistake};
    });
    std::stable_sort(tried.begin(), tried.end(),
                     [](const Tried& a, const Tried& b) { return a.first < b.first; });
    return tried;
  };
  const double as_it_is = left({});
  std::vector<const Mistake*> some;
  for (const Mistake& mistake : mistakes) some.push_back(&mistake);
  const std::vector<Tried> coarse = try_all(some);
  some.clear();
  for (std::size_t k = 0; k < std::min(kRefined, coarse.size()); ++k) {
    for (const Mistake& finer : coarse[k].second->finer) some.push_back(&finer);
  }
  std::vector<Tried> best = try_all(some);
  if (best.empty() || (!coarse.empty() && coarse.front().first <= best.front().first)) best = coarse;
  if (best.empty() || !std::isfinite(as_it_is) || !(best.front().first * kTakenAway < as_it_is)) return "";
  return best.front().second->with;
}

bool Compared(const DataSet& set) {
  return std::any_of(set.runs.begin(), set.runs.end(), [](const Run& run) { return !run.before.empty(); });
}

/// The set without its runs.
DataSet Bare(const DataSet& set) {
  DataSet bare;
  bare.name = set.name;
  bare.robot = set.robot;
  bare.fit_frame = set.fit_frame;
  return bare;
}

void Add(const Run& run, DataSet& to) {
  to.runs.push_back(run);
  to.runs.back().repeat_of.clear();
}

/// Some runs of different kinds, the shortest first.
DataSet SomeRuns(const DataSet& set) {
  std::vector<const Run*> runs;
  for (const Run& run : set.runs) runs.push_back(&run);
  std::stable_sort(runs.begin(), runs.end(),
                   [](const Run* a, const Run* b) { return a->time_s.size() < b->time_s.size(); });
  std::set<std::string> families;
  std::stable_partition(runs.begin(), runs.end(),
                        [&](const Run* run) { return families.insert(run->family).second; });
  DataSet some = Bare(set);
  for (std::size_t i = 0; i < std::min(kRuns, runs.size()); ++i) Add(*runs[i], some);
  return some;
}

/// A load cell that was set to zero otherwise than before the other runs: by what it shows more than torque,
/// or stretch, says.
void AddMovedZeros(const Evaluator& evaluator, std::size_t run, std::vector<Mistake>& all) {
  const sim::Cut by = evaluator.has(kC2) ? sim::Cut::kDrivetrain : sim::Cut::kTendon;
  for (std::size_t c = 0; c < evaluator.channels().size() && evaluator.has(kC3); ++c) {
    const Channel& channel = evaluator.channels()[c];
    if (channel.cut != by) continue;
    double sum_N = 0, count = 0;
    const auto& variance = evaluator.Variance()[run][c];
    for (Eigen::Index w = 0; w < variance.size(); ++w) {
      if (std::isfinite(variance[w])) sum_N += evaluator.AtNominal()[run][c][w], count += 1;
    }
    if (count == 0) continue;
    const double zero_N = sum_N / count;
    all.push_back({fmt::format("the zero of load cell {} moved by {:.2g} N", channel.index + 1, -zero_N),
                   [j = channel.index, zero_N](Run& moved) {
                     if (j < moved.tension_N.cols()) moved.tension_N.col(j).array() -= zero_N;
                   }});
  }
}

}  // namespace

std::string FindMistake(const DataSet& set, const Evaluator& evaluator, int threads) {
  if (Compared(set)) return "";
  std::map<Kind, std::vector<double>> of_kind;
  for (const Channel& channel : evaluator.channels())
    of_kind[{channel.cut, channel.quantity}].push_back(channel.floor);
  std::map<Kind, double> floors;
  for (auto& [kind, all] : of_kind) floors[kind] = Median(std::move(all));
  if (Misfit(evaluator, floors) < kLarge) return "";

  const DataSet some = SomeRuns(set);
  const auto misfit = [&](const Undo& undo) {
    DataSet tried = some;
    for (Run& run : tried.runs) {
      if (undo) undo(run);
    }
    try {
      return Misfit(Evaluator(tried, {.threads = 1, .readings = 0}), floors);
    } catch (const std::exception&) {
      return std::numeric_limits<double>::infinity();
    }
  };
  return WhatMakesItRight(AllMistakes(set, evaluator.has(kC3), evaluator.has_tracker()), misfit, threads);
}

std::vector<FrozenMotor> FindFrozenMotors(const DataSet& set, const Evaluator& evaluator) {
  constexpr double kFrozen_s = 0.3;
  constexpr double kHeld = 0.15;  // of the largest tension: more than a motor's friction holds
  const auto is_stretch = [](const Channel& channel) { return channel.cut == sim::Cut::kTendon; };
  std::vector<FrozenMotor> frozen;
  std::vector<std::size_t> run_of;  // by the evaluator's, which keeps none of those from before
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    if (!IsBefore(set, set.runs[i])) run_of.push_back(i);
  }
  for (std::size_t i = 0; i < run_of.size() && evaluator.has(kC3); ++i) {
    const Run& run = set.runs[run_of[i]];
    for (Eigen::Index j = 0; j < run.motor_position_rad.cols(); ++j) {
      const auto x = run.motor_position_rad.col(j);
      for (Eigen::Index from = 0, to = 1; from < x.size(); from = to++) {
        while (to < x.size() && x[to] == x[from]) ++to;
        if (run.time_s[to - 1] - run.time_s[from] < kFrozen_s) continue;
        const auto tension_N = run.tension_N.col(j).segment(from, to - from);
        const double width_N = UsualWidth({tension_N.begin(), tension_N.end()});
        if (width_N >= kHeld * set.robot.limits.max_tension_motor_N)
          frozen.push_back({i, j, from, to, width_N});
      }
    }
  }
  if (frozen.empty()) return frozen;

  // What stretch leaves of tension where no motor stands so, of each tendon and of all.
  const auto residuals = [&](std::size_t i, std::size_t c, double from_s, double to_s, Squares& squares) {
    const auto& variance = evaluator.Variance()[i][c];
    const double window_s = evaluator.window_s(static_cast<int>(i), static_cast<int>(c));
    for (Eigen::Index w = 0; w < variance.size(); ++w) {
      const double at_s = (static_cast<double>(w) + 0.5) * window_s;
      if (!std::isfinite(variance[w]) || at_s < from_s || at_s > to_s) continue;
      squares.sum += std::pow(evaluator.AtNominal()[i][c][w], 2);
      squares.count += 1;
    }
  };
  const auto span_s = [&](const FrozenMotor& f) {
    const Run& run = set.runs[run_of[f.run]];
    return std::pair(run.time_s[f.from] - run.time_s[0], run.time_s[f.to - 1] - run.time_s[0]);
  };
  std::map<Eigen::Index, Squares> moving;  // by tendon
  for (std::size_t c = 0; c < evaluator.channels().size(); ++c) {
    const Channel& channel = evaluator.channels()[c];
    if (!is_stretch(channel)) continue;
    Squares all, still;
    for (std::size_t i = 0; i < run_of.size(); ++i) residuals(i, c, 0, 1e300, all);
    for (const FrozenMotor& f : frozen) {
      if (f.tendon != channel.index) continue;
      const auto [from_s, to_s] = span_s(f);
      residuals(f.run, c, from_s, to_s, still);
    }
    moving[channel.index] = {all.sum - still.sum, all.count - still.count};
  }
  Squares usual;
  for (const auto& [tendon, squares] : moving) usual.sum += squares.sum, usual.count += squares.count;
  std::erase_if(frozen, [&](const FrozenMotor& f) {
    Squares its;
    const auto [from_s, to_s] = span_s(f);
    for (std::size_t c = 0; c < evaluator.channels().size(); ++c) {
      if (is_stretch(evaluator.channels()[c]) && evaluator.channels()[c].index == f.tendon)
        residuals(f.run, c, from_s, to_s, its);
    }
    const Squares& own = moving[f.tendon];
    const double least = std::max(usual.count > 0 ? usual.rms() : 0, own.count > 0 ? own.rms() : 0);
    return !(its.count > 0 && its.rms() > kLarge * least);
  });
  for (FrozenMotor& f : frozen) f.run = run_of[f.run];
  return frozen;
}

std::vector<OddRun> FindOddRuns(const DataSet& set, const Evaluator& evaluator, int threads) {
  if (Compared(set) || set.runs.size() < 2) return {};
  std::vector<std::map<Kind, Squares>> left;
  std::map<Kind, std::vector<double>> of_kind;
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    left.push_back(LeftOf(evaluator, i));
    for (const auto& [kind, squares] : left.back()) of_kind[kind].push_back(squares.rms());
  }
  std::map<Kind, double> usual;  // of two runs the better one's
  for (auto& [kind, all] : of_kind) {
    const auto middle = all.begin() + static_cast<std::ptrdiff_t>((all.size() - 1) / 2);
    std::nth_element(all.begin(), middle, all.end());
    if (all.size() > 1) usual[kind] = *middle;
  }
  const std::vector<Mistake> mistakes = MistakesOfReading(set, evaluator.has(kC3), evaluator.has_tracker());
  std::vector<OddRun> odd;
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    if (Worst(left[i], usual) < kLarge) continue;
    DataSet alone = Bare(set);
    Add(set.runs[i], alone);
    const auto worst = [&](const Undo& undo) {
      DataSet tried = alone;
      if (undo) undo(tried.runs.front());
      try {
        return Worst(LeftOf(Evaluator(tried, {.threads = 1, .readings = 0}), 0), usual);
      } catch (const std::exception&) {
        return std::numeric_limits<double>::infinity();
      }
    };
    std::vector<Mistake> its = mistakes;
    AddMovedZeros(evaluator, i, its);
    if (const std::string with = WhatMakesItRight(its, worst, threads); !with.empty())
      odd.push_back({i, with});
  }
  return odd;
}

}  // namespace tendril::gap
