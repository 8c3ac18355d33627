// The result of a diagnosis as plain data: everything that the report shows and report.json contains. Knows
// nothing of how it was found.
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
  bool measured = true;     // false: cannot be determined from these logs, `note` says why
  double rms = 0;           // of the residual
  double floor = 0;         // rms that noise and repeatability explain
  double excess_sigma = 0;  // sqrt(rms^2 - floor^2) / floor, 0 where rms is below the floor
  double delta = 0;         // materiality in `unit`
  double p_value = 1;       // probability that noise alone gives this excess (bootstrap over blocks)
  bool excess = false;      // significant (false discovery rate controlled) and larger than delta
  bool first = false;       // the first excess in the chain: the gap lies here
  std::string note;         // further explanation, a sentence

  /// Far beyond noise and materiality, but in too few seconds to be significant.
  bool uncertain() const {
    return measured && !excess && cut != sim::Cut::kClock && excess_sigma > 3 && rms > 2 * delta;
  }
};

/// One hypothesis with its probability. No hypothesis is certain: no_gap has at most 0.7 (0.6 where runs
/// repeat badly), because a gap may be too small for these data to show; the causes have at most 0.97
/// together.
struct Cause {
  std::string effect;  // registry name, "no_gap" or "unknown"
  std::string where;   // "all", "tendon:2", ...; empty for no_gap and unknown
  double p = 0;        // probability
  int group = 0;       // causes with the same number > 0 cannot be told apart by these runs
  std::map<std::string, Estimate> parameters;  // by name, as fitted
  bool bound_hit = false;                      // a fitted parameter lies at its bound
  double held_out_gain = 0;   // share of the excess mean square on held-out families that it removes
  double screening_gain = 0;  // held-out log score by the linear screening; 0 where the cause was refitted
  std::string note;           // further explanation, a sentence
};

/// How far the gap shrinks in one channel on held-out runs when the accepted causes are in the model.
struct Closure {
  std::string channel;  // "tension 1 from torque", "tip position", ...
  std::string unit;
  sim::Cut cut{};
  double before_rms = 0, after_rms = 0, floor_rms = 0;
  std::optional<Estimate> closed;        // empty: no significant gap at this place
  std::optional<double> ceiling_rms{};   // rms left when all parameters are refitted at once
  std::optional<double> as_filed_rms{};  // with the file's numbers, where `before` has those of earlier runs
};

/// Closure of the tip's position error for each family; with at least three families, each is predicted by a
/// fit to the others.
struct FamilyClosure {
  std::string family;                             // kind of motion
  int runs = 0;                                   // of this family
  double before_m = 0, after_m = 0, floor_m = 0;  // rms: nominal, with the causes, and the noise floor
  std::optional<Estimate> closed;                 // pooled as Diagnosis::closed; empty: no gap here
};

/// Similarity of two causes: the cosine of their sensitivities after projecting out nuisances and
/// calibration.
struct Confusion {
  std::string a, b;        // "effect where"
  double cosine = 0;       // of their sensitivities; 1: identical signatures
  double profile_gap = 0;  // held-out log score by which b is behind a, both refitted
  bool confirmed = false;  // the refitted scores confirm it too
};

/// What a simpler method would name first from the same search.
struct Baseline {
  std::string name;           // least_rmse, raw_bic, refit_everything, sparse_regression
  std::string effect, where;  // what the method names, or no_gap
};

/// Mean of a residual as a function of a condition, with a block-bootstrap band.
struct ConditionMap {
  sim::Cut cut{};                           // place in the chain
  std::string channel, unit;                // of the residual
  std::string condition, condition_unit;    // "speed of the tendon", "m/s"
  std::vector<double> at, mean, low, high;  // the condition's values, the mean there, and its band
  std::vector<double> after;  // mean with the accepted causes in the model; empty where there are none
};

/// Measured and simulated signal of a held-out run, before and after, for overlays and hysteresis loops.
struct Overlay {
  std::string run, channel, unit;                       // the run and its signal
  sim::Cut cut{};                                       // place in the chain
  double floor = 0;                                     // rms noise floor
  std::vector<double> time_s, measured, before, after;  // simulated without and with the causes
  std::string against;       // meaning of `x` for a loop: "displacement 1"; empty: plotted over time only
  std::string against_unit;  // unit of `x`
  std::vector<double> x;     // abscissa of the loop
};

/// Growth of the residual with the time since the simulation was reset to the measured state.
struct HorizonPoint {
  double horizon_s = 0;           // time since that reset
  double rms_m = 0, floor_m = 0;  // of the tip's residual, and its noise floor
};

/// A free run of the simulator: plants that start at rest and see nothing of a run but the torques that were
/// sent, where the other errors here are of simulations that follow the measured signals.
struct FreeRun {
  std::string run, family;        // the run whose torques drove them, and its kind of motion
  double duration_s = 0;          // of the part of it
  double moves_m = 0;             // rms of the measured tip about its mean
  double before_m = 0;            // rms error of the nominal robot's tip
  std::optional<double> after_m;  // with the causes; empty: none
};

/// How well a parameter is determined: the log score lost as a function of its value, all others refitted.
struct Profile {
  std::string effect, where, parameter;  // the parameter and its cause
  std::vector<double> value, score;      // the parameter's value, and the log score lost there
};

/// A number of the robot file that, at another value, explains the runs better than any cause in the library.
struct SuspectNumber {
  std::string key;                // "actuation.gear.ratio"
  double in_file = 0, value = 0;  // value in the file, and the value fitted to the runs, in the key's unit
  std::optional<Estimate>
      closed;  // share of the gap that the fitted value closes, pooled as Diagnosis::closed
};

/// A number of the robot file, fitted to the runs with all others within their priors.
struct LearnedNumber {
  std::string key;                // "body.sections.youngs_modulus_Pa"
  double in_file = 0, value = 0;  // in the key's unit
  double moved = 0;               // from the file, in standard deviations of the prior
};

struct NextExperiment {
  std::string family;           // name of the `tendril excite` family; empty: none needed, or none helps
  std::string reason;           // which rivals it separates and why
  double separation_sigma = 0;  // expected separation of the rivals
  std::string yaml;             // plan file for `tendril excite --plan`
  std::vector<std::pair<std::string, double>> alternatives;  // other families and their separation
};

struct HealthFinding {
  enum class Severity { kInfo, kWarning, kError };
  Severity severity = Severity::kInfo;  // how severely it affects the diagnosis
  std::string run, channel;             // where it was found
  double value = 0;                     // the measured number behind the finding
  std::string text;                     // what was found, what it means for the diagnosis, the remedy
};

struct RunSummary {
  std::string name, family, repeat_of, sha256;  // as in runs.yaml, and the hash of its file
  double duration_s = 0, rate_Hz = 0;           // length and typical rate of its rows
  int samples = 0;                              // rows
  std::string before, before_sha256;  // the run it was compared with; empty: compared with the model alone
};

/// Repetitions that differ by more than the sensors and the usual scatter of friction explain, or whose
/// differences beyond the sensors' noise are a function of a motor's angle. Reported at the place where that
/// is clearest. The robot was changed, or does something that its model does not contain.
struct Repeatability {
  sim::Cut cut{};                     // place in the chain
  std::string where, quantity, unit;  // as in CutFinding
  double rms = 0;                     // deviation of a run from the mean of its repetitions
  double floor = 0;                   // the part of it that the sensors explain
  double sigma = 0;                   // sqrt(rms^2 - floor^2) / floor
  std::string depends_on;  // "the angle of motor 2, 3 times a turn"; empty: none of the states tried
  double p_value = 1;      // probability that chance gives as much for any of the states tried
  bool law = false;        // the difference is a function of that angle, which friction scatter is not
};

struct Diagnosis {
  Verdict verdict = Verdict::kInsufficientData;  // the outcome
  std::string sentence;                 // where, what, how certain, how far the gap shrinks, what to do next
  std::vector<CutFinding> location;     // in chain order
  std::vector<Cause> causes;            // by falling p; with no_gap and unknown
  std::vector<Cause> accepted;          // the causes the model needs: none, one, or the members of a pair
  std::optional<Estimate> closed;       // on held-out runs, pooled over the channels with a significant gap
  std::vector<Closure> closures;        // by channel
  std::vector<FamilyClosure> families;  // by kind of motion
  std::optional<Estimate> closed_ceiling;  // closed when all parameters are refitted at once, an upper bound
  std::vector<std::pair<std::string, double>>
      order_effects;                     // closed by each cause of a pair alone, and after the other
  double leftover_sigma = 0;             // what the best model leaves beyond the floor on held-out data
  std::vector<LearnedNumber> learned;    // by falling distance; empty: the file explains the runs as it is
  std::vector<SuspectNumber> suspected;  // by falling score; these runs may not tell several apart
  std::string
      doubt;  // why the likeliest cause is not established, as a clause; empty where it is, or there is none
  std::vector<Confusion> confusable;  // pairs of causes that look alike in these runs
  std::vector<Baseline> baselines;    // what simpler methods would name
  std::vector<ConditionMap> maps;     // residuals against conditions
  std::vector<Overlay> overlays;      // curves of held-out runs
  std::vector<HorizonPoint> horizon;  // residual over simulated time
  std::vector<FreeRun> free_runs;     // by kind of motion
  std::vector<Profile> profiles;      // how well parameters are determined
  std::vector<std::pair<std::string, double>> input_correlations;  // of the residual left
  NextExperiment next;                         // the experiment that would separate the rivals best
  std::vector<std::string> next_commands;      // to run now, each a complete `tendril ...` line for a shell
  std::optional<Repeatability> repeatability;  // null: runs repeat, or none was repeated
  std::vector<HealthFinding> health;           // problems found in the logs
  std::vector<std::string> degradations;  // what these logs lack, and what therefore cannot be determined

  // provenance
  std::string robot_name, robot_yaml;          // nominal file, with all defaults filled in
  std::vector<RunSummary> runs;                // the runs used
  std::vector<std::string> held_out_families;  // each held out in turn while the others are fitted
  std::string held_out_by;                 // what is held out: kinds of motion, runs, quarters of the runs
  double delta_N = 0, delta_m = 0;         // materiality of tensions and of the tip position
  std::uint64_t seed = 0;                  // of the random number generator
  std::string version, revision, command;  // of the software; the command line
  double seconds = 0;  // duration of the diagnosis, the only number that differs between identical runs
};

}  // namespace tendril::gap
