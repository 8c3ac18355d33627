// Undoes each measurement error on a few runs and compares the remaining residual of the nominal robot.
#include "measured_wrong.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "comparable.h"
#include "health_signal.h"
#include "median.h"
#include "mistakes.h"
#include "squares.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

constexpr double kLarge = 8;       // floors, or times the residual of other runs: effects are rarely larger
constexpr double kTakenAway = 4;   // reduction of a gap that is due to this error
constexpr double kSmallest = 0.5;  // floors beyond the noise, for a small gap that may be due to an error
constexpr double kSmallTakenAway = 3;  // reduction of such a gap, which noise partly hides
constexpr double kHelps = 1.5;         // minimum reduction where a run shows the error most
constexpr double kLess = 0.5;     // of the comparisons before: the error concerned a sensor that is lost now
constexpr std::size_t kRuns = 3;  // for trying each error
constexpr double kTried_s = 12;   // of each run

using Kind = std::pair<sim::Cut, Channel::Quantity>;

/// Residuals of the nominal robot, by the kinds of channels that the runs have.
using KindResiduals = std::map<Kind, Squares>;

/// Calls with each residual of a run's channel.
template <class Call>
void ForEachResidual(const Evaluator& evaluator, std::size_t run, std::size_t channel, Call&& call) {
  const auto& variance = evaluator.Variance()[run][channel];
  for (Eigen::Index w = 0; w < variance.size(); ++w) {
    if (std::isfinite(variance[w])) call(evaluator.AtNominal()[run][channel][w]);
  }
}

void AddResiduals(const Evaluator& evaluator, std::size_t run, KindResiduals& left) {
  for (std::size_t c = 0; c < evaluator.channels().size(); ++c) {
    const Channel& channel = evaluator.channels()[c];
    ForEachResidual(evaluator, run, c, [&](double residual) {
      left[{channel.cut, channel.quantity}].Add(residual);
    });
  }
}

/// The kTried_s with the largest motor motion.
Run MostActivePart(const Run& run) {
  constexpr double kHop_s = 2;
  const Eigen::VectorXd& t = run.time_s;
  const double end_s = t[t.size() - 1];
  if (UsualStep(run) > kQuasiStatic_s || end_s - t[0] <= kTried_s) return run;
  const auto row = [&](double at_s) {
    return static_cast<int>(std::lower_bound(t.begin(), t.end(), at_s) - t.begin());
  };
  int first = 0, last = 0;
  const bool motors = run.motor_position_rad.array().isFinite().any();
  double farthest = -1;
  for (double from_s = t[0]; from_s + kTried_s < end_s + kHop_s; from_s += kHop_s) {
    const int a = row(from_s), b = row(from_s + kTried_s);
    double way = 0;
    for (Eigen::Index j = 0; j < run.motor_position_rad.cols(); ++j)
      way += RangeOf(run.motor_position_rad.col(j).segment(a, b - a)).width();
    // Without motors, the changes of the tensions count.
    for (Eigen::Index j = 0; j < run.tension_N.cols() && !motors; ++j)
      way += RangeOf(run.tension_N.col(j).segment(a, b - a)).width();
    if (way > farthest) farthest = way, first = a, last = b;
  }
  std::vector<int> rows(static_cast<std::size_t>(last - first));
  std::iota(rows.begin(), rows.end(), first);
  return OfRows(run, rows);
}

/// A set of these runs only.
DataSet SubsetOf(const DataSet& set, const std::vector<const Run*>& runs) {
  DataSet apart;
  apart.name = set.name;
  apart.robot = set.robot;
  apart.fit_frame = set.fit_frame;
  for (const Run* run : runs) {
    apart.runs.push_back(MostActivePart(*run));
    apart.runs.back().repeat_of.clear();
  }
  return apart;
}

/// The residuals of runs; empty where they cannot be simulated. `with_cells`: of load cells, or only without
/// them.
std::optional<KindResiduals> ResidualsOfRuns(const DataSet& apart, bool with_cells) {
  try {
    const Evaluator evaluator(apart, {.threads = 1, .readings = 0});
    KindResiduals left;
    for (std::size_t i = 0; i < evaluator.runs().size(); ++i) AddResiduals(evaluator, i, left);
    // Without cells torque is compared with a different quantity.
    if (with_cells && !evaluator.has_cells())
      left.erase({sim::Cut::kDrivetrain, Channel::Quantity::kTension});
    return left;
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

/// The same with an error undone.
std::optional<KindResiduals> ResidualsOnceUndone(DataSet apart, const Mistake* mistake,
                                                 const Evaluator& whole) {
  if (mistake != nullptr) mistake->Undo(apart);
  return ResidualsOfRuns(apart, whole.has_cells());
}

/// True where as much can be compared as before.
bool ComparesAsMuch(const std::optional<KindResiduals>& left, const KindResiduals& before) {
  return left && std::all_of(before.begin(), before.end(), [&](const auto& of_kind) {
           const auto found = left->find(of_kind.first);
           return found != left->end() && found->second.count >= kLess * of_kind.second.count;
         });
}

/// Mean over the kinds of channels, in floors.
double Misfit(const KindResiduals& left, const std::map<Kind, double>& floors) {
  double total = 0;
  int kinds = 0;
  for (const auto& [kind, squares] : left) {
    const auto floor = floors.find(kind);
    if (floor == floors.end() || !(floor->second > 0)) continue;
    // Residuals at the noise level are indistinguishable from none.
    total += std::hypot(1.0, squares.rms() / floor->second);
    ++kinds;
  }
  return kinds > 0 ? total / kinds : 0;
}

/// The largest kind beyond the noise, in floors.
double LargestBeyondNoise(const KindResiduals& left, const std::map<Kind, Squares>& noise,
                          const std::map<Kind, double>& floors) {
  double most = 0;
  for (const auto& [kind, squares] : left) {
    const auto found = noise.find(kind);
    const auto floor = floors.find(kind);
    if (found == noise.end() || floor == floors.end() || !(floor->second > 0)) continue;
    const double beyond = std::pow(squares.rms(), 2) - std::pow(found->second.rms(), 2);
    most = std::max(most, std::sqrt(std::max(0.0, beyond)) / floor->second);
  }
  return most;
}

/// The largest kind, relative to the usual value.
double LargestMisfit(const KindResiduals& left, const std::map<Kind, double>& usual) {
  double worst = 0;
  for (const auto& [kind, squares] : left) {
    const auto found = usual.find(kind);
    if (found != usual.end() && found->second > 0) worst = std::max(worst, squares.rms() / found->second);
  }
  return worst;
}

/// True where a kind becomes large that was not, or larger.
bool Worsens(const KindResiduals& after, const KindResiduals& before, const std::map<Kind, double>& usual) {
  return std::any_of(after.begin(), after.end(), [&](const auto& of_kind) {
    const auto found = usual.find(of_kind.first);
    const auto was = before.find(of_kind.first);
    const double least_rms = was == before.end() ? 0 : was->second.rms();
    return found != usual.end() && of_kind.second.rms() > std::max(kLarge / 2 * found->second, least_rms);
  });
}

/// The error whose correction leaves the smallest residual, and that residual.
struct Found {
  const Mistake* mistake = nullptr;
  double left = std::numeric_limits<double>::infinity();
};
Found BestCorrection(const std::vector<Mistake>& mistakes, const std::function<double(const Mistake*)>& left,
                     int threads) {
  constexpr std::size_t kRefined = 3;
  const auto try_all = [&](const std::vector<const Mistake*>& some) {
    std::vector<Found> tried(some.size());
    ParallelFor(static_cast<int>(some.size()), threads, [&](int m) {
      const Mistake* mistake = some[static_cast<std::size_t>(m)];
      tried[static_cast<std::size_t>(m)] = {mistake, left(mistake)};
    });
    std::stable_sort(tried.begin(), tried.end(),
                     [](const Found& a, const Found& b) { return a.left < b.left; });
    return tried;
  };
  std::vector<const Mistake*> some;
  for (const Mistake& mistake : mistakes) some.push_back(&mistake);
  const std::vector<Found> coarse = try_all(some);
  some.clear();
  for (std::size_t k = 0; k < std::min(kRefined, coarse.size()); ++k) {
    for (const Mistake& finer : coarse[k].mistake->finer) {
      if (std::isfinite(coarse[k].left)) some.push_back(&finer);
    }
  }
  const std::vector<Found> fine = try_all(some);
  Found best;
  for (const auto* tried : {&coarse, &fine}) {
    if (!tried->empty() && tried->front().left < best.left) best = tried->front();
  }
  return best;
}

/// Tendon whose load cell disagrees far more than any other with torque in runs [from, to), or without torque
/// with stretch, which also depends on errors of other cells through the body; -1: none.
int DisagreeingCell(const Evaluator& evaluator, std::size_t from, std::size_t to) {
  constexpr double kFar = 2;
  const sim::Cut cut = evaluator.has(kC2) ? sim::Cut::kDrivetrain : sim::Cut::kTendon;
  std::map<int, double> by_tendon;  // floors
  for (std::size_t c = 0; c < evaluator.channels().size() && evaluator.has(kC3); ++c) {
    const Channel& channel = evaluator.channels()[c];
    if (channel.cut != cut) continue;
    Squares squares;
    for (std::size_t i = from; i < to; ++i)
      ForEachResidual(evaluator, i, c, [&](double residual) { squares.Add(residual); });
    if (squares.count > 0 && channel.floor > 0) by_tendon[channel.index] = squares.rms() / channel.floor;
  }
  int odd = -1;
  double most = 0, second = 0;
  for (const auto& [tendon, floors] : by_tendon) {
    if (floors > most)
      second = std::exchange(most, floors), odd = tendon;
    else
      second = std::max(second, floors);
  }
  return most > kFar * second ? odd : -1;
}

Measured MeasuredOf(const Evaluator& evaluator, std::size_t from, std::size_t to) {
  return {evaluator.has_cells(), evaluator.has_tracker(), DisagreeingCell(evaluator, from, to)};
}

/// Some runs of different families except one: runs with all sensors first, then the shortest.
std::vector<const Run*> SomeRuns(const DataSet& set, const Run* but) {
  const auto lacks = [](const Run* run) {
    return !run->tension_N.array().isFinite().any() + !run->tip_m.array().isFinite().any();
  };
  std::vector<const Run*> runs;
  for (const Run& run : set.runs) {
    if (&run != but) runs.push_back(&run);
  }
  std::stable_sort(runs.begin(), runs.end(), [&](const Run* a, const Run* b) {
    return std::pair(lacks(a), a->time_s.size()) < std::pair(lacks(b), b->time_s.size());
  });
  std::set<std::string> families;
  std::stable_partition(runs.begin(), runs.end(),
                        [&](const Run* run) { return families.insert(run->family).second; });
  runs.resize(std::min(kRuns, runs.size()));
  return runs;
}

/// Enough states for a test, spread over a run.
Run SomeStates(const Run& run) {
  constexpr int kStates = 100;
  const auto rows = static_cast<int>(run.time_s.size());
  std::vector<int> some;
  for (int i = 0; i < rows; i += std::max(1, rows / kStates)) some.push_back(i);
  return OfRows(run, some);
}

/// Reduction of the kind of channels that falls most; 0 where another kind rises.
double ReductionFactor(const KindResiduals& after, const KindResiduals& before) {
  constexpr double kRises = 2;
  double most = 0;
  for (const auto& [kind, squares] : before) {
    const auto found = after.find(kind);
    if (found == after.end() || !(found->second.rms() > 0)) continue;
    if (found->second.rms() > kRises * squares.rms()) return 0;
    most = std::max(most, squares.rms() / found->second.rms());
  }
  return most;
}

/// A load cell that was zeroed differently from the other runs: its mean difference from torque, or without
/// torque from stretch.
void AddMovedZeros(const Evaluator& evaluator, std::size_t run, std::vector<Mistake>& all) {
  std::map<int, double> zero_N;  // by tendon
  for (const sim::Cut by : {sim::Cut::kDrivetrain, sim::Cut::kTendon}) {
    for (std::size_t c = 0; c < evaluator.channels().size() && evaluator.has(kC3); ++c) {
      const Channel& channel = evaluator.channels()[c];
      if (channel.cut != by || zero_N.contains(channel.index)) continue;
      double sum_N = 0, count = 0;
      ForEachResidual(evaluator, run, c, [&](double residual) { sum_N += residual, count += 1; });
      if (count > 0) zero_N[channel.index] = sum_N / count;
    }
  }
  for (const auto& [tendon, by_N] : zero_N) all.push_back(MovedZero(tendon, by_N));
}

}  // namespace

void RefuseOtherTime(const DataSet& set) {
  if (Compared(set)) return;
  DataSet motions = set;
  std::erase_if(motions.runs, [](const Run& run) { return !Smooth(run); });
  constexpr double kFastest_s = 2e-5;  // of a log's rows
  const auto slow = [](const Run& run) { return UsualStep(run) > kQuasiStatic_s; };
  const auto motion = [&](const Run& run) { return UsualStep(run) > kFastest_s && !slow(run); };
  if (motions.runs.empty() || !std::all_of(set.runs.begin(), set.runs.end(), slow)) return;
  const std::vector<const Run*> some = SomeRuns(motions, nullptr);
  DataSet states = SubsetOf(motions, some);
  for (Run& run : states.runs) run = SomeStates(run);
  const std::optional<KindResiduals> at_rest = ResidualsOfRuns(states, false);
  if (!at_rest) return;
  for (const TimeUnit& unit : kTimeUnits) {
    DataSet in_time = motions;
    for (Run& run : in_time.runs) run.time_s *= unit.seconds;
    if (!std::all_of(in_time.runs.begin(), in_time.runs.end(), motion)) continue;
    const std::optional<KindResiduals> left =
        ResidualsOfRuns(SubsetOf(in_time, SomeRuns(in_time, nullptr)), false);
    if (!left || ReductionFactor(*left, *at_rest) < kLarge) continue;
    throw std::runtime_error(fmt::format(
        "the time of these runs seems to be in {}: rows are {:.4g} s apart ({}), motors move smoothly from "
        "row to row, and the robot file leaves residuals up to {:.2g} times smaller in that unit; accepted: "
        "seconds; divide t_s by {:.0f} in every run",
        unit.name, UsualStep(*some.front()), some.front()->name, ReductionFactor(*left, *at_rest),
        1 / unit.seconds));
  }
}

FoundMistake FindMistake(const DataSet& set, const Evaluator& evaluator, bool explained, int threads) {
  if (Compared(set)) return {};
  std::map<Kind, std::vector<double>> of_kind;
  std::map<Kind, Squares> noise;
  // Where repetitions differ by far more than noise, a measurement error may be the reason.
  const bool scatter = evaluator.repetitions_differ() > 0;
  for (std::size_t c = 0; c < evaluator.channels().size(); ++c) {
    const Channel& channel = evaluator.channels()[c];
    const double by = scatter ? evaluator.repetitions_by()[static_cast<Eigen::Index>(c)] : 1;
    of_kind[{channel.cut, channel.quantity}].push_back(channel.floor / by);
    for (const auto& run : evaluator.Variance()) {
      for (const double variance : run[c]) {
        if (std::isfinite(variance)) noise[{channel.cut, channel.quantity}].Add(std::sqrt(variance) / by);
      }
    }
  }
  std::map<Kind, double> floors;
  for (auto& [kind, all] : of_kind) floors[kind] = Median(std::move(all));
  KindResiduals all;
  for (std::size_t i = 0; i < evaluator.runs().size(); ++i) AddResiduals(evaluator, i, all);
  // Of a small unexplained gap only the part beyond the noise counts, since noise would hide its removal.
  const bool small = !explained && LargestMisfit(all, floors) < kTakenAway;
  const auto misfit_of = [&](const KindResiduals& left) {
    return explained ? Misfit(left, floors)
           : small   ? LargestBeyondNoise(left, noise, floors)
                     : LargestMisfit(left, floors);
  };
  if (misfit_of(all) < (explained ? kLarge : small ? kSmallest : kTakenAway)) return {};

  const std::vector<const Run*> runs = SomeRuns(set, nullptr);
  const DataSet some = SubsetOf(set, runs);
  const std::optional<KindResiduals> as_they_are = ResidualsOnceUndone(some, nullptr, evaluator);
  if (!as_they_are) return {};
  // Most errors are excluded by the run with the largest residual.
  DataSet first;
  std::optional<KindResiduals> first_as_it_is;
  for (const Run* run : runs) {
    DataSet alone = SubsetOf(set, {run});
    std::optional<KindResiduals> left = ResidualsOnceUndone(alone, nullptr, evaluator);
    if (!left || (first_as_it_is && misfit_of(*left) <= misfit_of(*first_as_it_is))) continue;
    first = std::move(alone);
    first_as_it_is = std::move(left);
  }
  if (!first_as_it_is) return {};
  const auto may_be = [&](const Mistake* mistake) {
    const std::optional<KindResiduals> left = ResidualsOnceUndone(first, mistake, evaluator);
    return ComparesAsMuch(left, *first_as_it_is) && kHelps * misfit_of(*left) < misfit_of(*first_as_it_is);
  };
  const auto misfit = [&](const Mistake* mistake) {
    if (!may_be(mistake)) return std::numeric_limits<double>::infinity();
    const std::optional<KindResiduals> left = ResidualsOnceUndone(some, mistake, evaluator);
    const bool other =
        !ComparesAsMuch(left, *as_they_are) || (!explained && Worsens(*left, *as_they_are, floors));
    // Where the worst place is at its noise level, the other places distinguish sizes.
    constexpr double kOthers = 0.1;
    return other ? std::numeric_limits<double>::infinity()
                 : misfit_of(*left) + kOthers * Misfit(*left, floors);
  };
  const std::vector<Mistake> mistakes = AllMistakes(set, MeasuredOf(evaluator, 0, evaluator.runs().size()));
  const Found found = BestCorrection(mistakes, misfit, threads);
  if (!std::isfinite(found.left)) return {};
  const std::optional<KindResiduals> left = ResidualsOnceUndone(some, found.mistake, evaluator);
  const double smaller = small ? kSmallTakenAway : kTakenAway;
  if (!left || !(smaller * misfit_of(*left) < misfit_of(*as_they_are))) return {};
  return {found.mistake->with, LargestMisfit(*left, floors)};
}

std::vector<DeviatingRun> FindDeviatingRuns(const DataSet& set, const Evaluator& evaluator,
                                            std::map<std::string, double>& missed, int threads) {
  if (Compared(set) || set.runs.size() < 2) return {};
  std::vector<KindResiduals> left(set.runs.size());
  std::map<Kind, std::vector<double>> of_kind;
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    AddResiduals(evaluator, i, left[i]);
    for (const auto& [kind, squares] : left[i]) of_kind[kind].push_back(squares.rms());
  }
  std::map<Kind, double> usual;  // the smaller of the values of two runs
  for (auto& [kind, all] : of_kind) {
    const auto middle = all.begin() + static_cast<std::ptrdiff_t>((all.size() - 1) / 2);
    std::nth_element(all.begin(), middle, all.end());
    if (all.size() > 1) usual[kind] = *middle;
  }
  std::vector<DeviatingRun> odd;
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    const Run& run = set.runs[i];
    const double by = LargestMisfit(left[i], usual);
    if (by < kLarge || !missed.emplace(run.name, by).second) continue;
    const DataSet alone = SubsetOf(set, {&run});
    const std::optional<KindResiduals> as_it_is = ResidualsOnceUndone(alone, nullptr, evaluator);
    if (!as_it_is || LargestMisfit(*as_it_is, usual) < kLarge) continue;
    const auto worst = [&](const Mistake* mistake) {
      const std::optional<KindResiduals> its = ResidualsOnceUndone(alone, mistake, evaluator);
      return ComparesAsMuch(its, *as_it_is) ? LargestMisfit(*its, usual)
                                            : std::numeric_limits<double>::infinity();
    };
    std::vector<Mistake> mistakes = MistakesOfReading(set, MeasuredOf(evaluator, i, i + 1));
    AddMovedZeros(evaluator, i, mistakes);
    const Found found = BestCorrection(mistakes, worst, threads);
    if (found.left > kLarge / 2 || kTakenAway * found.left > LargestMisfit(*as_it_is, usual)) continue;
    // The others must be right as they are; otherwise it is an error in all runs that this one shows most.
    const DataSet others = SubsetOf(set, SomeRuns(set, &run));
    const std::optional<KindResiduals> before = ResidualsOnceUndone(others, nullptr, evaluator);
    const std::optional<KindResiduals> after = ResidualsOnceUndone(others, found.mistake, evaluator);
    if (before && (!ComparesAsMuch(after, *before) || Worsens(*after, *before, usual)))
      odd.push_back({i, found.mistake->with});
  }
  return odd;
}

}  // namespace tendril::gap
