// The diagnosis from end to end: prepare, locate, search, judge, and the details for the reader.
#include "tendril/gap/diagnose.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "baselines.h"
#include "closure.h"
#include "comparable.h"
#include "details.h"
#include "evaluator.h"
#include "first_place.h"
#include "floor_at_cause.h"
#include "free_run.h"
#include "judge.h"
#include "learned_robot.h"
#include "locate.h"
#include "measured_wrong.h"
#include "measurement_check.h"
#include "postures/diagnose_postures.h"
#include "reach.h"
#include "readable.h"
#include "repeatability.h"
#include "search.h"
#include "sentence.h"
#include "tendril/config/config.h"
#include "tendril/core/parallel.h"
#include "tendril/core/version.h"
#include "tendril/gap/words.h"
#include "unseen_effects.h"

namespace tendril::gap {
namespace {

/// Lowers the causes' probabilities, because a measurement error is likelier than each of them.
void ShiftToUnknown(std::vector<Cause>& causes) {
  constexpr double kLeft = 0.3;  // share of their probability that is kept
  double taken = 0;
  for (Cause& cause : causes) {
    if (sim::FindEffect(cause.effect) == nullptr) continue;
    taken += (1 - kLeft) * cause.p;
    cause.p *= kLeft;
  }
  for (Cause& cause : causes) {
    if (cause.effect == "unknown") cause.p += taken;
  }
  std::stable_sort(causes.begin(), causes.end(), [](const Cause& a, const Cause& b) { return a.p > b.p; });
}

/// Ends the diagnosis where no pose of the robot explains the tip path: the best fit would not be a cause.
void NameNoCause(Diagnosis& d, const PathBeyondReach& path, const RobotParameters& robot) {
  d.verdict = Verdict::kUnexplained;
  Cause unknown, none;
  unknown.effect = "unknown";
  unknown.p = 1 - kLapse;
  none.effect = "no_gap";
  none.p = 1 - unknown.p;
  d.causes = {unknown, none};
  d.sentence = fmt::format(
      "No pose of robot '{}' explains the recorded tip path, so no cause is named: in run {} the tip moves "
      "{:.3g} mm from its rest position, which needs a backbone at least {:.3g} mm long, and the file's is "
      "{:.3g} mm (body.sections: units, unit_length_m). At rest the tip is {:.3g} mm from the tracker's "
      "origin. Check that the robot file describes the robot that was measured, that the tracked point is "
      "the centre of the last disk, and the tracker's scale; then diagnose again.",
      robot.name, path.run, 1e3 * path.moved_m, 1e3 * path.needed_m, 1e3 * robot.body.length_m(),
      1e3 * path.at_rest_m);
  d.next.reason = "diagnose these runs with the file of the robot that was measured";
}

/// The steps of one diagnosis, in order, and what they share.
class Diagnosing {
 public:
  Diagnosing(const DataSet& given, const DiagnoseOptions& options)
      : given_(given),
        options_(options),
        threads_(options.threads > 0 ? options.threads : AllCores()),
        evaluation_{threads_, options.delta_N, options.delta_m, options.seed} {}

  Diagnosis Result() {
    PrepareSet();
    MeasurementCheck measuring(set_, d_.degradations, options_, threads_, Compared(given_));
    evaluator_.emplace(measuring.PrepareComparable());
    ListRuns();
    LocateGap();
    // For a change since earlier runs, errors of the robot file cancel.
    const auto beyond = Compared(set_) ? std::nullopt : FindPathBeyondReach(set_);
    if (beyond) {
      NameNoCause(d_, *beyond, set_.robot);
      MarkFirst(d_, Place());
      AddDetails(*evaluator_, nullptr, evaluator_->AtNominal(), options_.seed, d_);
      return std::move(d_);
    }
    SearchCauses();
    TakeRepeatabilityOfCause();
    TakeFloorOfCause();
    JudgeCauses();
    LearnNumbers();
    ReportUnseenEffects();
    RejectIfModelWasWrongBefore();
    MeasureClosure();
    PlanNextExperiment();
    MarkPlaces();
    WeighMistake();
    ComposeSentence(measuring.missed());
    return std::move(d_);
  }

 private:
  /// The findings about one nominal robot.
  struct Standing {
    RobotParameters robot;
    Evaluator evaluator;
    std::vector<Probe> probes;
    SearchResult search;
    Judgement judgement;  // points into `search`
    std::vector<CutFinding> location;
  };

  void Progress(const std::string& stage, double fraction) const {
    if (options_.progress) options_.progress(stage, fraction);
  }
  /// Progress within stage_.
  std::function<void(double)> InStage() {
    return [this](double fraction) { Progress(stage_, fraction); };
  }
  void Say(const std::vector<std::string>& lines) {
    d_.degradations.insert(d_.degradations.end(), lines.begin(), lines.end());
  }
  LoadCellPlace Place() const { return evaluator_->runs().front().signals.load_cell; }

  void PrepareSet() {
    Progress("aligning the logs and finding the noise floor", 0);
    RequireAMotorForEachTendon(given_.robot);
    ReadableSet readable = Readable(given_, d_.degradations);
    set_ = std::move(readable.set);
    contradictions_ = std::move(readable.contradictions);
    d_.robot_name = set_.robot.name;
    d_.robot_yaml = config::ToYaml(given_.robot);
    d_.seed = options_.seed;
    d_.version = Version();
    d_.revision = GitRevision();
  }

  /// Takes the runs from before a change out of the set and lists the others.
  void ListRuns() {
    std::map<std::string, std::string> before_sha256;
    for (const Run& run : set_.runs) before_sha256.emplace(run.before, "");
    std::erase_if(set_.runs, [&](const Run& run) {
      const auto named = before_sha256.find(run.name);
      if (named == before_sha256.end()) return false;
      named->second = run.sha256;
      return true;
    });
    Say(evaluator_->degradations());
    std::stable_partition(d_.degradations.begin(), d_.degradations.end(),
                          [](const std::string& line) { return line.starts_with("left out: "); });
    for (std::size_t i = 0; i < set_.runs.size(); ++i) {
      const auto& run = set_.runs[i];
      const auto& prepared = evaluator_->runs()[i];
      d_.runs.push_back({run.name, run.family, run.repeat_of, run.sha256,
                         prepared.samples() * prepared.signals.step_s, 1 / prepared.signals.step_s,
                         static_cast<int>(run.time_s.size()), run.before, before_sha256[run.before]});
    }
  }

  void LocateGap() {
    d_.delta_N = d_.delta_m = 0;
    for (const auto& channel : evaluator_->channels()) {
      if (channel.quantity == Channel::Quantity::kTension) d_.delta_N = std::max(d_.delta_N, channel.delta);
      if (channel.quantity == Channel::Quantity::kTipPosition)
        d_.delta_m = std::max(d_.delta_m, channel.delta);
    }
    d_.location = Locate(*evaluator_, evaluator_->AtNominal(), kGapDiscoveries);
  }

  void SearchCauses() {
    folds_ = MakeFolds(evaluator_->runs());
    d_.held_out_families = folds_.names;
    d_.held_out_by = folds_.by;
    stage_ = "screening every effect";
    ProbeEffects({});
    stage_ = "searching for the cause";
    search_ = SearchIn(*evaluator_, {});
  }

  /// Finds what each effect does in these runs. `learned`: numbers that follow the runs, so that an effect
  /// which only changes one of them everywhere is no cause beside it.
  void ProbeEffects(const std::vector<FileNumber>& learned) {
    const auto excluded = [&](const Candidate& candidate) {
      const std::string_view name = candidate.effect->name;
      if (std::find(options_.without.begin(), options_.without.end(), name) != options_.without.end())
        return true;
      return !candidate.target && std::any_of(learned.begin(), learned.end(), [&](const FileNumber& number) {
        return number.effect == name;
      });
    };
    probes_ = MakeProbes(*evaluator_, excluded, threads_, InStage());
  }

  SearchResult SearchIn(const Evaluator& those, const Nuisances& numbers, bool pairs = true) {
    SearchOptions options;
    options.numbers = numbers;
    options.pairs = pairs;
    options.threads = threads_;
    options.refits = options_.refits;
    options.progress = InStage();
    constexpr double kExplained_sigma = 0.15;  // left at a place: half of the least effect that shall be seen
    options.explained = [&](const Residuals& residuals) {
      for (const auto& f : Locate(those, residuals, kLeftDiscoveries)) {
        if (f.excess && f.cut != sim::Cut::kClock && f.excess_sigma > kExplained_sigma) return false;
      }
      return true;
    };
    return Search(those, folds_, options, probes_);
  }

  /// Empty where another cause is found: the floor may be raised only for the cause that raises it.
  std::optional<SearchResult> SearchAgain(const Evaluator& those, const Model& cause) {
    SearchResult again = SearchIn(those, {});
    return ContainsCause(again, cause) ? std::optional(std::move(again)) : std::nullopt;
  }

  void TakeRepeatabilityOfCause() {
    if (!MayHideCause(*evaluator_) || Compared(set_)) return;
    stage_ = "searching for what makes repetitions differ";
    auto narrow = WithRepeatabilityOfCause(*evaluator_, set_, MayNotRepeat(search_), evaluation_);
    if (!narrow && evaluator_->repetitions_differ() > 0) {
      // Differences between repetitions may hide small causes, and also the large one that makes them.
      const Evaluator repeated = AsThoughRepeated(set_, evaluation_);
      narrow = WithRepeatabilityOfCause(*evaluator_, set_, MayNotRepeat(SearchIn(repeated, {})), evaluation_);
    }
    stage_ = "searching again with the repeatability of the cause";
    std::optional<SearchResult> again;
    if (narrow) again = SearchAgain(narrow->evaluator, narrow->cause);
    if (!again) return;
    for (const auto& line : evaluator_->degradations()) std::erase(d_.degradations, line);
    *evaluator_ = std::move(narrow->evaluator);
    search_ = std::move(*again);
    LocateGap();
    d_.degradations.push_back(
        fmt::format("repetitions differ by {:.2g} times the sensor noise, mostly as {} makes them differ; "
                    "only the rest counts as noise floor",
                    narrow->differed, narrow->cause.Name()));
    Say(evaluator_->degradations());
  }

  void TakeFloorOfCause() {
    auto wide = WithFloorOfCause(*evaluator_, set_, search_, evaluation_);
    if (!wide) return;
    stage_ = "searching again with the floor of the cause";
    auto again = SearchAgain(*wide, search_.fits.front().model);
    // Unless no gap would be left to close.
    if (again && PooledClosure(*wide, wide->AtNominal(), wide->AtNominal(),
                               ChannelsWithGap(*wide, d_.location), options_.seed)) {
      widened_by_ = again->fits.front().model.parts.front();
      *evaluator_ = std::move(*wide);
      search_ = std::move(*again);
    }
  }

  void JudgeCauses() {
    Progress("judging", 0);
    SubtractNoiseGain(*evaluator_, set_, evaluation_, search_);
    const auto fit_numbers = [&]() -> std::vector<NumberFit> {
      if (Compared(set_)) return {};  // errors of the file were present before the change as well
      constexpr int kRefined = 6;
      stage_ = "fitting the numbers of the robot file";
      return FitNumbers(*evaluator_, search_.leftover, search_.nuisances, folds_, kRefined, threads_,
                        InStage());
    };
    judgement_ = Judge(*evaluator_, search_, d_.location, options_.seed, fit_numbers);
    Adopt();
    if (widened_by_ && d_.verdict != Verdict::kNoGap) {
      d_.degradations.push_back(fmt::format(
          "{} amplifies the sensor noise more than the nominal robot does; the noise floor includes this",
          widened_by_->Name()));
    }
  }

  void Adopt() {
    d_.verdict = judgement_.verdict;
    d_.causes = judgement_.causes;
    d_.accepted = judgement_.accepted;
    d_.confusable = judgement_.confusable;
    d_.leftover_sigma = judgement_.leftover_sigma;
    d_.suspected = judgement_.suspected;
    d_.doubt = judgement_.doubt;
    d_.repeatability = evaluator_->repeatability();
    d_.baselines = Baselines(*evaluator_, search_);
  }

  /// Where no cause is established with the file as it is: its numbers fitted to the runs within their
  /// uncertainties, and causes beside them.
  void LearnNumbers() {
    const bool established = d_.verdict != Verdict::kUnexplained && d_.doubt.empty();
    if (established || judgement_.unrepeated || Compared(set_)) return;
    FreeNumbers free = FreeNumbersOf(set_.robot);
    LookForMistake();
    if (free.size() == 0 || !mistake_.with.empty() || OneNumberCloses()) return;
    Standing as_filed{set_.robot, std::move(*evaluator_), std::move(probes_), std::move(search_), judgement_,
                      d_.location};
    stage_ = "fitting the numbers of the robot file together";
    const LearnOptions options{.threads = threads_, .progress = InStage()};
    const auto alone = Learn(as_filed.evaluator, std::move(free), folds_, options);
    if (alone && LogEvidence(as_filed.evaluator, *alone) > 0 && ExplainedByNumbers(as_filed, *alone)) return;
    set_.robot = std::move(as_filed.robot);
    evaluator_ = std::move(as_filed.evaluator);
    probes_ = std::move(as_filed.probes);
    search_ = std::move(as_filed.search);
    judgement_ = std::move(as_filed.judgement);
    d_.location = std::move(as_filed.location);
  }

  /// One number that closes the gap is a simpler explanation than all of them.
  bool OneNumberCloses() const {
    return std::any_of(d_.suspected.begin(), d_.suspected.end(), [](const SuspectNumber& number) {
      return number.closed && number.closed->value > 1 - kMayStay;
    });
  }

  bool ExplainedByNumbers(const Standing& as_filed, const LearnedNumbers& alone) {
    if (!SearchWith(RobotWith(alone, as_filed.robot), false)) return false;
    // Numbers that moved to explain a cause move back where it is in the model.
    stage_ = "fitting them beside the likeliest causes";
    const LearnOptions options{.threads = threads_, .progress = InStage()};
    const auto beside = LearnBesideCause(as_filed.evaluator, alone, LikelyCauses(search_), folds_, options);
    return ExplainedWith(RobotWith(beside ? *beside : alone, as_filed.robot));
  }

  /// Searches for causes beside numbers that stay free. False where that robot cannot be simulated in these
  /// runs.
  bool SearchWith(const LearnedRobot& learned, bool pairs) {
    set_.robot = learned.robot;
    try {
      evaluator_.emplace(set_, evaluation_);
    } catch (const std::exception&) {
      return false;
    }
    LocateGap();
    stage_ = "screening every effect with the numbers fitted";
    ProbeEffects(learned.numbers.free.numbers);
    stage_ = "searching for the cause with the numbers fitted";
    search_ = SearchIn(*evaluator_, learned.open, pairs);
    return true;
  }

  /// True where this robot, which its file has to allow, explains the runs with or without a cause.
  bool ExplainedWith(const LearnedRobot& learned) {
    constexpr double kMostMoved = 3;  // deviations of the prior: more contradicts it
    if (!SearchWith(learned, true)) return false;
    judgement_ =
        Judge(*evaluator_, search_, d_.location, options_.seed, [] { return std::vector<NumberFit>(); });
    const bool established =
        judgement_.verdict == Verdict::kNoGap || (judgement_.best != nullptr && judgement_.doubt.empty());
    std::vector<LearnedNumber> found = learned.At(judgement_.best);
    if (!established || std::abs(found.front().moved) >= kMostMoved) return false;
    d_.learned = std::move(found);
    Adopt();
    return true;
  }

  /// Effects that these runs could not show, however large.
  void ReportUnseenEffects() {
    const UnseenEffects found = FindUnseenEffects(*evaluator_, search_);
    const std::vector<std::string>& unseen = found.names;
    if (!unseen.empty()) {
      std::string names;
      for (const auto& name : unseen) names += (names.empty() ? "" : ", ") + name;
      d_.degradations.push_back("not excited enough to be seen even when clearly wrong: " + names);
    }
    const bool far_off = std::any_of(d_.location.begin(), d_.location.end(),
                                     [](const CutFinding& f) { return f.uncertain(); });
    // What lies beyond the robot's range was left out, and is itself a gap.
    const bool partial = far_off || !contradictions_.empty() || 2 * unseen.size() > found.searched;
    if (d_.verdict == Verdict::kNoGap && partial) d_.verdict = Verdict::kInsufficientData;
  }

  void RejectIfModelWasWrongBefore() {
    distrusted_ = evaluator_->useless() && d_.verdict != Verdict::kNoGap;
    if (!distrusted_) return;
    d_.verdict = Verdict::kInsufficientData;
    d_.accepted.clear();
    d_.degradations.push_back(fmt::format(
        "the model error was {} of the motion before the change already, so no cause is named; diagnose the "
        "runs from before on their own, apply the result to the robot file (gap apply), then compare",
        Percent(evaluator_->wrong_before())));
  }

  void MeasureClosure() {
    const Residuals& before = evaluator_->AtNominal();
    const Fit* shown = judgement_.best;
    if (shown == nullptr && d_.verdict == Verdict::kUnexplained && !judgement_.unrepeated)
      shown = judgement_.nearest;
    const std::vector<char> with_gap = ChannelsWithGap(*evaluator_, d_.location);
    Residuals after = before;
    if (shown != nullptr) {
      after = Completed(shown->held_out, before);
      d_.closed = PooledClosure(*evaluator_, before, after, with_gap, options_.seed);
    }
    // Without a significant place and without any closure there may be no gap.
    if (d_.verdict == Verdict::kUnexplained && d_.closed && d_.closed->value <= 0 &&
        std::none_of(d_.location.begin(), d_.location.end(), [](const CutFinding& f) { return f.excess; }))
      d_.verdict = Verdict::kInsufficientData;
    d_.closures = Closures(*evaluator_, before, after, with_gap, options_.seed);
    d_.families = ClosuresByFamily(*evaluator_, before, after, with_gap, options_.seed);
    if (!search_.everything.empty() && d_.verdict != Verdict::kNoGap) {
      d_.closed_ceiling = PooledClosure(*evaluator_, before, search_.everything, with_gap, options_.seed);
      const ChannelScore everything = ScoreChannels(*evaluator_, search_.everything, before);
      for (std::size_t c = 0; c < d_.closures.size(); ++c)
        d_.closures[c].ceiling_rms = std::sqrt(everything.square[static_cast<int>(c)]);
    }
    if (d_.accepted.size() == 2) AddOrders(*evaluator_, search_, with_gap, options_.seed, d_);
    RunFree(shown);
    if (shown != nullptr) d_.profiles = ProfilesOf(*evaluator_, folds_, search_, *shown, threads_);
    AddDetails(*evaluator_, shown ? &shown->model : nullptr, after, options_.seed, d_);
  }

  void RunFree(const Fit* shown) {
    std::optional<RobotParameters> with_cause;
    if (shown != nullptr) with_cause = shown->model.Robot(evaluator_->nominal());
    d_.free_runs = FreeRuns(*evaluator_, with_cause ? &*with_cause : nullptr, threads_);
  }

  void PlanNextExperiment() {
    if (!d_.suspected.empty()) {
      d_.next.reason = fmt::format("measure {} on the robot, correct the file, and diagnose these runs again",
                                   d_.suspected.front().key);
      return;
    }
    if (!options_.menu.families.empty()) Progress("looking for the next experiment", 0);
    d_.next = FindNextExperiment(*evaluator_, search_, d_, options_.menu, threads_);
  }

  /// A mistake of measurement with the robot of the file: one thing, where the numbers of the file are many.
  void LookForMistake() {
    const bool follows = judgement_.unrepeated && d_.repeatability->law;  // unlike a measurement error
    if (mistake_looked_for_ || follows ||
        (d_.verdict == Verdict::kNoGap && evaluator_->repetitions_differ() == 0))
      return;
    mistake_looked_for_ = true;
    Progress("looking for measurement errors", 0);
    const bool explained = d_.verdict != Verdict::kUnexplained && d_.verdict != Verdict::kNoGap &&
                           !judgement_.unrepeated && d_.leftover_sigma < kMuchLeft_sigma;
    mistake_ = FindMistake(set_, *evaluator_, explained, threads_);
  }

  void MarkPlaces() {
    if (distrusted_ || (d_.verdict != Verdict::kNoGap && d_.verdict != Verdict::kInsufficientData))
      MarkFirst(d_, Place());
    if (judgement_.unrepeated && d_.repeatability->law) MarkUnrepeated(d_);
  }

  void WeighMistake() {
    LookForMistake();
    if (mistake_.with.empty()) return;
    // A cause that leaves much is doubtful where a measurement error explains most.
    if (!d_.accepted.empty() && d_.leftover_sigma >= kMuchLeft_sigma &&
        mistake_.left < std::hypot(1, d_.leftover_sigma)) {
      d_.verdict = Verdict::kInsufficientData;
      d_.accepted.clear();
      ShiftToUnknown(d_.causes);
    }
    mistake_hides_ = d_.verdict == Verdict::kNoGap || judgement_.unrepeated;
    if (mistake_hides_) d_.verdict = Verdict::kInsufficientData;
  }

  /// `missed`: runs with a far larger model error than the others, and the ratio.
  void ComposeSentence(const std::map<std::string, double>& missed) {
    std::string hiding;
    if (judgement_.hidden_at) {
      const auto& parts = judgement_.nearest->model.parts;
      hiding = fmt::format(
          "{} and {} would only if they cancelled each other at {}, where there is no gap; one effect that "
          "the library lacks is likelier",
          parts[0].Name(), parts[1].Name(), sim::CutName(*judgement_.hidden_at));
    }
    d_.sentence = judgement_.unrepeated
                      ? Unrepeated(*d_.repeatability)
                      : WithLearned(Preface(d_) + Sentence(d_, set_.robot, hiding), d_.learned);
    if (d_.repeatability && !judgement_.unrepeated) d_.sentence += UnrepeatedRemark(*d_.repeatability);
    if (!d_.repeatability && evaluator_->repetitions_differ() > 0) {
      d_.sentence += fmt::format(
          " But repetitions differ by {:.2g} times the noise: if the robot was changed between them, they do "
          "not define the noise floor.",
          evaluator_->repetitions_differ());
    }
    d_.sentence += FewRunsRemark(d_, missed);
    if (!mistake_.with.empty()) {
      d_.sentence =
          fmt::format("Check the measurement first: with {} most of {} disappears. {}", mistake_.with,
                      mistake_hides_ ? "the difference between repetitions" : "this gap", d_.sentence);
      d_.degradations.insert(
          d_.degradations.begin(),
          fmt::format("a measurement error? with {} most of {} disappears; correct the data set or the robot "
                      "file and diagnose again",
                      mistake_.with, mistake_hides_ ? "the difference between repetitions" : "the gap"));
    }
    if (!contradictions_.empty()) {
      d_.sentence = fmt::format("Check units and robot file first: {}, so it is left out. {}",
                                fmt::join(contradictions_, "; "), d_.sentence);
    }
    std::vector<std::string> notes = given_.notes;
    notes.insert(notes.end(), d_.degradations.begin(), d_.degradations.end());
    d_.sentence = WithLeftOut(d_.sentence, notes, d_.runs.size());
  }

  const DataSet& given_;
  const DiagnoseOptions& options_;
  const int threads_;
  const Evaluator::Options evaluation_;
  DataSet set_;                              // given_, with what cannot be used masked or left out
  std::vector<std::string> contradictions_;  // between the readings and the robot's range
  Diagnosis d_;
  std::optional<Evaluator> evaluator_;  // of set_; from PrepareComparable on
  Folds folds_;
  std::vector<Probe> probes_;
  SearchResult search_;
  std::optional<Candidate> widened_by_;  // the cause that raises the floor
  Judgement judgement_;                  // points into search_
  bool distrusted_ = false;              // the model was too wrong before the change
  FoundMistake mistake_;
  bool mistake_looked_for_ = false;
  bool mistake_hides_ = false;  // in the difference between repetitions
  std::string stage_;           // for progress
};

}  // namespace

Diagnosis Diagnose(const DataSet& given, const DiagnoseOptions& options) {
  if (CanDiagnosePostures(given)) return DiagnosePostures(given, options);
  return Diagnosing(given, options).Result();
}

}  // namespace tendril::gap
