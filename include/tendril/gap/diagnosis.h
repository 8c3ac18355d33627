// What a diagnosis found, as plain data: everything the report shows and report.json mirrors. Knows nothing
// of how it was found.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tendril/sim/effects.h"

namespace tendril::gap {

/// A number with its 95 % interval.
struct Estimate {
  double value = 0;
  double low = 0, high = 0;
};

enum class Verdict { kNoGap, kAttributed, kAmbiguousGroup, kUnexplained, kInsufficientData };
/// "no_gap", "attributed", "ambiguous_group", "unexplained", "insufficient_data".
std::string VerdictName(Verdict verdict);

/// The residual (measured less simulated) behind one cut, of one tendon's tension or one section's tip.
struct CutFinding {
  sim::Cut cut{};
  std::string where;        // "tendon:2", "section:1" or "all"
  std::string quantity;     // "tension", "torque", "tip position", "tip direction", "timestamps"
  std::string unit;         // "N", "m", "rad", "N·m", "s"
  bool measured = true;     // false: cannot be told from these logs, `note` says why
  double rms = 0;           // of the residual
  double floor = 0;         // rms that noise and repetition explain
  double excess_sigma = 0;  // sqrt(rms^2 - floor^2) / floor, 0 when below
  double delta = 0;         // materiality in `unit`
  double p_value = 1;       // of the excess being noise (bootstrap over blocks)
  bool excess = false;      // passes delta with false discoveries controlled
  bool first = false;       // the first in the chain: here lies the gap
  std::string note;         // what else is to be said of it, a sentence

  /// Far beyond noise and materiality, in too few seconds to be no chance.
  bool uncertain() const {
    return measured && !excess && cut != sim::Cut::kClock && excess_sigma > 3 && rms > 2 * delta;
  }
};

/// One hypothesis with its probability. None is certain: no_gap has at most 0.7 (0.6 where runs repeat
/// badly), since what is too small for the data is a gap too, and causes 0.97 together.
struct Cause {
  std::string effect;  // registry name, "no_gap" or "unknown"
  std::string where;   // "all", "tendon:2", ...; empty for no_gap and unknown
  double p = 0;        // probability
  int group = 0;       // causes with the same number > 0 cannot be told apart by these runs
  std::map<std::string, Estimate> parameters;  // by name, as fitted
  bool bound_hit = false;                      // a parameter came to its bound
  double held_out_gain = 0;   // share of the excess mean square on held-out families that it removes
  double screening_gain = 0;  // held-out log score that the linear screening saw; 0 where it was refitted
  std::string note;           // what else is to be said of it, a sentence
};

/// How far the gap shrinks in one channel when the named causes are in the model, on held-out trajectories.
struct Closure {
  std::string channel;  // "tension 1 from torque", "tip position", ...
  std::string unit;
  sim::Cut cut{};
  double before_rms = 0, after_rms = 0, floor_rms = 0;
  std::optional<Estimate> closed;       // empty: its place has no gap for sure
  std::optional<double> ceiling_rms{};  // what is left when everything is refitted at once
};

/// The same of the tip's distance, family by family: each predicted by a fit to the other families, where
/// there are at least three.
struct FamilyClosure {
  std::string family;                             // kind of motion
  int runs = 0;                                   // of this family
  double before_m = 0, after_m = 0, floor_m = 0;  // rms: nominal, with the causes, what noise explains
  std::optional<Estimate> closed;                 // pooled as Diagnosis::closed; empty: no gap here
};

/// Two causes and how alike their marks are: cosine of their sensitivities with nuisances and calibration
/// removed.
struct Confusion {
  std::string a, b;        // "effect where"
  double cosine = 0;       // of their marks; 1: alike
  double profile_gap = 0;  // held-out log score that b is behind a, both refitted
  bool confirmed = false;  // by the profile too
};

/// What a simpler way of judging the same search would name first.
struct Baseline {
  std::string name;           // least_rmse, raw_bic, refit_everything, sparse_regression
  std::string effect, where;  // what it names, or no_gap
};

/// Mean of a residual against a condition, with a block-bootstrap band.
struct ConditionMap {
  sim::Cut cut{};                           // the place in the chain
  std::string channel, unit;                // of the residual
  std::string condition, condition_unit;    // "speed of the tendon", "m/s"
  std::vector<double> at, mean, low, high;  // the condition, the mean there, and its band
  std::vector<double> after;                // mean after the cause is in the model, empty without one
};

/// Held-out run: measured, simulated before and after; for overlays and hysteresis loops.
struct Overlay {
  std::string run, channel, unit;                       // which run, which signal
  sim::Cut cut{};                                       // the place in the chain
  double floor = 0;                                     // rms that noise explains
  std::vector<double> time_s, measured, before, after;  // before and after the causes are in the model
  std::string against;       // what `x` is, for a loop: "displacement 1"; empty: only over time
  std::string against_unit;  // unit of `x`
  std::vector<double> x;     // what the curves are drawn against
};

/// Growth of the residual with the time since the simulation was set to the measured state.
struct HorizonPoint {
  double horizon_s = 0;           // time since the simulation was set to the measured state
  double rms_m = 0, floor_m = 0;  // of the tip's residual, and what noise explains
};

/// How well a parameter is determined: log score lost over its value, others following.
struct Profile {
  std::string effect, where, parameter;  // whose profile it is
  std::vector<double> value, score;      // the parameter's value, and the log score lost there
};

/// A number of the robot file that, at another value, explains the runs better than any cause of the library.
struct SuspectNumber {
  std::string key;                 // "actuation.gear.ratio"
  double in_file = 0, value = 0;   // there, and what the runs point to, in the key's unit
  std::optional<Estimate> closed;  // share of the gap that goes with it, pooled as Diagnosis::closed
};

struct NextExperiment {
  std::string family;           // what `tendril excite` calls it; empty: none needed or none helps
  std::string reason;           // in words: which rivals, why this run separates them
  double separation_sigma = 0;  // how far the rivals would part
  std::string yaml;             // file that `tendril excite --plan` runs
  std::vector<std::pair<std::string, double>> alternatives;  // other families with their separation
};

struct HealthFinding {
  enum class Severity { kInfo, kWarning, kError };
  Severity severity = Severity::kInfo;  // how much of the diagnosis it concerns
  std::string run, channel;             // where it was found
  double value = 0;                     // the number behind it
  std::string text;                     // what was found, what it means for the diagnosis, the remedy
};

struct RunSummary {
  std::string name, family, repeat_of, sha256;  // of the run, as runs.yaml has them, and of its file
  double duration_s = 0, rate_Hz = 0;           // length and usual rate of its rows
  int samples = 0;                              // rows
  std::string before, before_sha256;            // what it was compared with; empty: the model alone
};

/// Runs that differ from their repetitions by more than the sensors and a usual scatter of friction explain,
/// or, beyond the sensors, by a function of a motor's angle; at the place where that shows most. The robot
/// does something that its model does not have, or was changed.
struct Repeatability {
  sim::Cut cut{};                     // place in the chain
  std::string where, quantity, unit;  // as in CutFinding
  double rms = 0;                     // by which each of two runs is off what they have in common
  double floor = 0;                   // what the sensors leave of that
  double sigma = 0;                   // sqrt(rms^2 - floor^2) / floor
  std::string depends_on;             // "the angle of motor 2, 3 times a turn"; empty: no state that was tried
  double p_value = 1;                 // of chance making as much of any state that was tried
  bool law = false;                   // it is a function of that angle, as no scatter of friction is
};

struct Diagnosis {
  Verdict verdict = Verdict::kInsufficientData;  // the outcome
  std::string sentence;                          // where, what, how sure, how far it shrinks, what next
  std::vector<CutFinding> location;              // in chain order
  std::vector<Cause> causes;                     // by falling p; with no_gap and unknown
  std::vector<Cause> accepted;                   // what the model needs: empty, one, or the members of a pair
  std::optional<Estimate> closed;       // on held-out runs, pooled over the channels that have a gap for sure
  std::vector<Closure> closures;        // by channel
  std::vector<FamilyClosure> families;  // by kind of motion
  std::optional<Estimate> closed_ceiling;  // what refitting everything at once closes, as an upper mark
  std::vector<std::pair<std::string, double>>
      order_effects;                     // closed by each of a pair alone and after the other
  double leftover_sigma = 0;             // what the best model leaves beyond the floor on held-out data
  std::vector<SuspectNumber> suspected;  // by falling score; several cannot be told apart by these runs
  std::string
      doubt;  // why the likeliest cause is not established, as a clause; empty: it is, or there is none
  std::vector<Confusion> confusable;  // pairs of causes that look alike in these runs
  std::vector<Baseline> baselines;    // what simpler ways of judging would name
  std::vector<ConditionMap> maps;     // residuals against conditions
  std::vector<Overlay> overlays;      // curves of held-out runs
  std::vector<HorizonPoint> horizon;  // residual over the time simulated
  std::vector<Profile> profiles;      // how well parameters are determined
  std::vector<std::pair<std::string, double>> input_correlations;  // of what is left with the inputs
  NextExperiment next;                     // the run that would separate the rivals best
  std::vector<std::string> next_commands;  // to run now, each a whole `tendril ...` line for a shell
  std::optional<Repeatability> repeatability;  // how runs do not repeat; null: they do, or none is repeated
  std::vector<HealthFinding> health;       // what was found wrong with the logs
  std::vector<std::string> degradations;   // what these logs lack and what can therefore not be said

  // provenance
  std::string robot_name, robot_yaml;          // nominal file, resolved
  std::vector<RunSummary> runs;                // the runs used
  std::vector<std::string> held_out_families;  // each held out in turn, the others trained on
  std::string held_out_by;                     // what they are: kinds of motion, runs, quarters of the runs
  double delta_N = 0, delta_m = 0;             // materiality of tensions and of the tip
  std::uint64_t seed = 0;                      // of the random numbers
  std::string version, revision, command;      // of the software, and how it was called
  double seconds = 0;                          // it took; the only number that differs between equal runs
};

}  // namespace tendril::gap
