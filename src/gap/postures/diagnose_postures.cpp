// Learns, weighs, and puts the result into words and places.
#include "diagnose_postures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "../interval.h"
#include "../judge.h"
#include "../readable.h"
#include "../sentence.h"
#include "directions.h"
#include "posterior.h"
#include "tendril/config/config.h"
#include "tendril/core/parallel.h"
#include "tendril/core/version.h"
#include "tendril/model/body.h"

namespace tendril::gap {
namespace {

constexpr std::size_t kInReport = 12;  // causes listed in the report

std::vector<const Run*> RunsOf(const DataSet& set, bool before) {
  std::vector<const Run*> runs;
  for (const Run& run : set.runs) {
    if (before == run.before.empty()) runs.push_back(&run);
  }
  return runs;
}

class Diagnosing {
 public:
  Diagnosing(const DataSet& given, const DiagnoseOptions& options)
      : readable_(Readable(given, d_.degradations)),
        set_(readable_.set),
        options_(options),
        threads_(options.threads > 0 ? options.threads : AllCores()) {}

  Diagnosis Result() {
    before_ = PosturesOf(RunsOf(set_, true), set_.robot);
    after_ = PosturesOf(RunsOf(set_, false), set_.robot);
    KeepCommonPoints();
    for (std::string& line : ReadDirections(before_, readable_.set.robot))
      d_.degradations.push_back(std::move(line));
    learned_ = LearnPostures(set_.robot, before_, !set_.fit_frame,
                             {threads_, Stage("learning the robot from the runs before the change")});
    search_ = SearchChange(
        learned_, set_.robot, before_, after_,
        {options_.refits, options_.delta_m, options_.without, threads_, Stage("weighing every change")});
    posterior_ = PosteriorOf(learned_, search_, options_.delta_m);
    Provenance();
    Locate();
    ListCauses();
    Decide();
    Closures();
    Overlays();
    Limits();
    const std::string preface = posterior_.not_learned ? NotLearnedText(learned_, before_, "the runs before")
                                : d_.suspected.empty() ? Preface(d_)
                                                       : NumbersText();
    d_.sentence = WithLeftOut(preface + Sentence(d_, set_.robot, ""), set_.notes, d_.runs.size());
    return std::move(d_);
  }

 private:
  std::function<void(double)> Stage(const char* name) const {
    return [this, name](double fraction) {
      if (options_.progress) options_.progress(name, fraction);
    };
  }

  /// Those that the runs before and after show.
  void KeepCommonPoints() {
    std::vector<PosturePoint> both;
    std::set_intersection(before_.points.begin(), before_.points.end(), after_.points.begin(),
                          after_.points.end(), std::back_inserter(both));
    if (both.empty())
      throw std::runtime_error("the runs before and after show no common disk; accepted: the same markers");
    before_.Keep(both);
    after_.Keep(both);
  }

  void Provenance() {
    d_.robot_name = set_.robot.name;
    d_.robot_yaml = config::ToYaml(set_.robot);
    d_.seed = options_.seed;
    d_.version = Version();
    d_.revision = GitRevision();
    d_.held_out_by = "quarters of the runs";
    for (const Run* run : RunsOf(set_, false)) {
      const auto named = std::find_if(set_.runs.begin(), set_.runs.end(),
                                      [&](const Run& other) { return other.name == run->before; });
      const Eigen::Index rows = run->time_s.size();
      const double duration_s = std::max(1e-9, run->time_s[rows - 1] - run->time_s[0]);
      d_.runs.push_back({run->name, run->family, run->repeat_of, run->sha256, duration_s,
                         static_cast<double>(rows - 1) / duration_s, static_cast<int>(rows), run->before,
                         named == set_.runs.end() ? "" : named->sha256});
    }
  }

  /// "section:2" of a section's last disk, "unit:3" of another.
  std::string WhereOf(int disk) const {
    const model::Body body(set_.robot.body);
    const int unit = body.disk_unit(disk);
    for (int k = 0; k < body.sections(); ++k) {
      if (unit + 1 == body.end_unit(k)) return fmt::format("section:{}", k + 1);
    }
    return fmt::format("unit:{}", unit + 1);
  }

  void Locate() {
    for (const sim::Cut cut : {sim::Cut::kCurrentLoop, sim::Cut::kDrivetrain, sim::Cut::kTendon}) {
      CutFinding f;
      f.cut = cut;
      f.where = "all";
      f.measured = false;
      f.note = "needs torques or tensions";
      d_.location.push_back(f);
    }
    bool first = true;
    for (int p = 0; p < static_cast<int>(before_.points.size()); ++p) {
      const PosturePoint& point = before_.points[static_cast<std::size_t>(p)];
      const double per_unit = before_.PerUnit(3 * p);
      CutFinding f;
      f.cut = sim::Cut::kShape;
      f.where = WhereOf(point.disk);
      f.quantity = point.turn ? "disk orientation" : "disk position";
      f.unit = before_.UnitOf(3 * p);
      f.rms = PointRms(search_.before_m, p) / per_unit;
      f.floor = learned_.Floor(p) / per_unit;
      f.excess_sigma = Excess(learned_, search_.before_m, p) / learned_.Floor(p);
      f.delta = LeastThatMatters(learned_, p, options_.delta_m) / per_unit;
      f.p_value = posterior_.none;
      f.excess = posterior_.none < 0.5 && HasExcess(learned_, search_.before_m, p, options_.delta_m);
      f.first = f.excess && std::exchange(first, false);
      if (!point.turn) d_.delta_m = std::max(d_.delta_m, f.delta);
      d_.location.push_back(f);
    }
    CutFinding motion;
    motion.cut = sim::Cut::kMotion;
    motion.where = "all";
    motion.measured = false;
    motion.note = "states are compared, not motion";
    d_.location.push_back(motion);
  }

  const PostureChange& ChangeOf(const ChangeFit& fit) const {
    return search_.changes[static_cast<std::size_t>(fit.change)];
  }

  /// Of the k-th fit.
  Cause CauseOf(const ChangeFit& fit, std::size_t k) const {
    const PostureChange& change = ChangeOf(fit);
    Cause cause;
    cause.effect = change.effect->effect->name;
    cause.where = change.effect->where;
    cause.p = posterior_.fits[k];
    const bool alone = std::count(posterior_.same.begin(), posterior_.same.end(), 1) == 1;
    cause.group = posterior_.same[k] && !alone ? 1 : 0;
    if (!fit.refined) cause.note = "screened only, not refitted";
    for (int i = 0; i < change.size(); ++i) {
      const sim::EffectParameter& parameter = change.effect->parameters[static_cast<std::size_t>(i)];
      const double value = change.ValueAt(i, fit.z[i]);
      const double half = kTwoSided95 * std::sqrt(std::max(0.0, fit.covariance(i, i)));
      cause.parameters[parameter.name] = {value, change.ValueAt(i, fit.z[i] - half),
                                          change.ValueAt(i, fit.z[i] + half)};
      cause.bound_hit |= value < parameter.lower || value > parameter.upper;
    }
    return cause;
  }

  void ListCauses() {
    for (std::size_t k = 0; k < search_.fits.size() && d_.causes.size() < kInReport; ++k) {
      if (ChangeOf(search_.fits[k]).effect) d_.causes.push_back(CauseOf(search_.fits[k], k));
    }
    ListNumbers();
    Cause none, unknown;
    none.effect = "no_gap";
    none.p = posterior_.none;
    unknown.effect = "unknown";
    unknown.p = posterior_.unlisted + of_numbers_;
    d_.causes.push_back(none);
    d_.causes.push_back(unknown);
    std::stable_sort(d_.causes.begin(), d_.causes.end(),
                     [](const Cause& a, const Cause& b) { return a.p > b.p; });
  }

  /// Numbers that are no effect, where one of them is the likeliest change and as well established as an
  /// effect has to be.
  void ListNumbers() {
    for (std::size_t k = 0; k < search_.fits.size(); ++k) {
      if (ChangeOf(search_.fits[k]).number) of_numbers_ += posterior_.fits[k];
    }
    if (posterior_.none >= 0.5 || of_numbers_ < 0.5 * (1 - posterior_.none) || !posterior_.doubt.empty())
      return;
    if (!ChangeOf(search_.fits.front()).number) return;
    for (std::size_t k = 0; k < search_.fits.size(); ++k) {
      const ChangeFit& fit = search_.fits[k];
      const PostureChange& change = ChangeOf(fit);
      if (!change.number || !posterior_.same[k]) continue;
      const double value = change.ValueAt(0, fit.z[0]);
      d_.suspected.push_back({change.number->key, change.number->in_file, value, posterior_.closed});
    }
  }

  std::string NumbersText() const {
    std::string numbers;
    for (const SuspectNumber& number : d_.suspected) {
      numbers += fmt::format("{}{} changed by a factor of {:.4g}", numbers.empty() ? "" : " or ", number.key,
                             number.value / number.in_file);
    }
    return fmt::format("No effect of the library, but one number explains most: {}. Check it on the robot. ",
                       numbers);
  }

  void Decide() {
    d_.leftover_sigma = posterior_.leftover_sigma;
    d_.closed = posterior_.closed;
    d_.doubt = posterior_.doubt;
    double listed = 0, group = 0;
    const Cause* first = nullptr;
    for (const Cause& cause : d_.causes) {
      if (sim::FindEffect(cause.effect) == nullptr) continue;
      if (first == nullptr) first = &cause;
      listed += cause.p;
    }
    for (std::size_t k = 0; k < posterior_.fits.size(); ++k) {
      if (posterior_.same[k]) group += posterior_.fits[k];
    }
    if (posterior_.not_learned) {
      d_.verdict = Verdict::kInsufficientData;
    } else if (posterior_.none >= 0.5) {
      d_.verdict = Verdict::kNoGap;
    } else if (first == nullptr || listed < 0.5 * (1 - posterior_.none) || !d_.doubt.empty()) {
      d_.verdict = Verdict::kUnexplained;
    } else {
      d_.verdict = first->p < kClear * group ? Verdict::kAmbiguousGroup : Verdict::kAttributed;
      d_.accepted = {*first};
    }
  }

  /// The change that is accepted, else the likeliest.
  const ChangeFit& Shown() const {
    for (const ChangeFit& fit : search_.fits) {
      const std::optional<Candidate>& effect = ChangeOf(fit).effect;
      if (!d_.accepted.empty() && effect && d_.accepted.front().effect == effect->effect->name &&
          d_.accepted.front().where == effect->where)
        return fit;
    }
    return search_.fits.front();
  }

  void Closures() {
    if (search_.fits.empty()) return;
    const Eigen::MatrixXd& best = Shown().held_out_m;
    const Eigen::MatrixXd& after =
        d_.verdict == Verdict::kNoGap || best.size() == 0 ? search_.before_m : best;
    for (Eigen::Index c = 0; c < after.cols(); ++c) {
      d_.closures.push_back({.channel = before_.ChannelName(c),
                             .unit = before_.UnitOf(c),
                             .cut = sim::Cut::kShape,
                             .before_rms = ChannelRms(search_.before_m, c) / before_.PerUnit(c),
                             .after_rms = ChannelRms(after, c) / before_.PerUnit(c),
                             .floor_rms = ChannelRms(learned_.held_out_m, c) / before_.PerUnit(c),
                             .closed = std::nullopt,
                             .as_filed_rms = ChannelRms(search_.as_filed_m, c) / before_.PerUnit(c)});
    }
  }

  /// Each channel in the run after in which the robot from before misses it most.
  void Overlays() {
    const bool with_change =
        d_.verdict != Verdict::kNoGap && !search_.fits.empty() && Shown().held_out_m.size() > 0;
    for (Eigen::Index c = 0; c < search_.before_m.cols(); ++c) {
      const auto missed = [&](const StateRange& rows) {
        return search_.before_m.col(c).segment(rows.first, rows.count).squaredNorm() /
               static_cast<double>(rows.count);
      };
      StateRange rows;
      const States* worst = nullptr;
      Eigen::Index first = 0;
      for (const States& run : after_.runs) {
        const StateRange its{first, run.time_s.size()};
        if (worst == nullptr || missed(its) > missed(rows)) worst = &run, rows = its;
        first += its.count;
      }
      const auto list = [&](const Eigen::VectorXd& values) {
        const Eigen::VectorXd in_unit = values / before_.PerUnit(c);
        return std::vector<double>(in_unit.begin(), in_unit.end());
      };
      const auto modelled = [&](const Eigen::MatrixXd& residuals_m) {
        return list(worst->seen_m.col(c) - residuals_m.col(c).segment(rows.first, rows.count));
      };
      Overlay overlay;
      overlay.run = worst->run;
      overlay.channel = before_.ChannelName(c);
      overlay.unit = before_.UnitOf(c);
      overlay.cut = sim::Cut::kShape;
      overlay.floor = ChannelRms(learned_.held_out_m, c) / before_.PerUnit(c);
      overlay.time_s = {worst->time_s.begin(), worst->time_s.end()};
      overlay.measured = list(worst->seen_m.col(c));
      overlay.before = modelled(search_.before_m);
      if (with_change) overlay.after = modelled(Shown().held_out_m);
      d_.overlays.push_back(std::move(overlay));
    }
  }

  void Limits() {
    d_.degradations.insert(d_.degradations.end(), set_.notes.begin(), set_.notes.end());
    d_.degradations.insert(d_.degradations.end(), readable_.contradictions.begin(),
                           readable_.contradictions.end());
    if (learned_.unsolved > 0) {
      d_.degradations.push_back(fmt::format(
          "{} states without an equilibrium of the learned robot: their disks are those of the state "
          "before",
          learned_.unsolved));
    }
    d_.degradations.push_back(
        "neither torques nor tensions: drives, drivetrains and tendons (C1 to C3) cannot be judged, mistakes "
        "of measurement were not searched for, and loads are relative to the robot's own weight and "
        "stiffness");
    d_.degradations.push_back(fmt::format(
        "the robot as learned from the runs before misses its disks by {} in states that it was not "
        "fitted to: the floor",
        PointsText(before_, [&](int p) { return learned_.Floor(p); })));
    d_.degradations.push_back("its numbers furthest from the file: " + NumbersMoved());
    if (std::string drift = ClockDriftText(learned_); !drift.empty())
      d_.degradations.push_back(std::move(drift));
    for (const Postures* postures : {&before_, &after_}) {
      for (std::string& line : postures->Lost()) d_.degradations.push_back(std::move(line));
    }
    if (!learned_.converged)
      d_.degradations.push_back("the numbers of the robot had not settled after the allowed steps");
  }

  std::string NumbersMoved() const {
    constexpr std::size_t kNamed = 4;
    std::vector<std::pair<double, std::string>> moved;  // prior deviations
    for (std::size_t k = 0; k < learned_.numbers.size(); ++k) {
      const PostureNumber& number = learned_.numbers[k];
      if (!number.value) continue;
      moved.emplace_back(
          std::abs(learned_.x[static_cast<Eigen::Index>(k)]) / number.deviation,
          fmt::format("{} {:.3g} where {:.3g} {}", number.key,
                      number.ValueAt(set_.robot, learned_.x[static_cast<Eigen::Index>(k)]),
                      number.value(set_.robot), number.assumed ? "is usual" : "is in the file"));
    }
    std::sort(moved.rbegin(), moved.rend());
    std::string text;
    for (std::size_t k = 0; k < std::min(kNamed, moved.size()); ++k)
      text += (k > 0 ? ", " : "") + moved[k].second;
    return text;
  }

  Diagnosis d_;
  ReadableSet readable_;
  const DataSet& set_;
  const DiagnoseOptions& options_;
  const int threads_;
  Postures before_, after_;
  LearnedPostures learned_;
  ChangeSearch search_;
  ChangePosterior posterior_;
  double of_numbers_ = 0;  // probability of all numbers
};

}  // namespace

bool CanLearnPostures(const DataSet& set) {
  return ShowsPostures(set) && EnoughPostures(RunsOf(set, true), set.robot);
}

bool CanDiagnosePostures(const DataSet& set) {
  return CanLearnPostures(set) && EnoughPostures(RunsOf(set, false), set.robot);
}

Diagnosis DiagnosePostures(const DataSet& set, const DiagnoseOptions& options) {
  return Diagnosing(set, options).Result();
}

}  // namespace tendril::gap
