// Checks of measured runs, one function per question; see the header.
#include "tendril/gap/health.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "health_signal.h"
#include "implausible.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

using Severity = HealthFinding::Severity;
using Matrix = Eigen::MatrixXd;

// Minimum reach, as a share of its length, of a robot that is straight at times.
constexpr double kNearest = 0.8;
constexpr double kRest_s = 0.5;  // initial rest of a run
constexpr double kPi = std::numbers::pi;

/// A kind of channel: its matrix in a run, its name and its usual unit.
struct Kind {
  Eigen::MatrixXd Run::*matrix;
  const char* name;
  const char* unit;
  bool a_tendon;  // one column per tendon
};
constexpr Kind kTarget{&Run::torque_target_Nm, "target torque", "N m", true};
constexpr Kind kActual{&Run::torque_actual_Nm, "actual torque", "N m", true};
constexpr Kind kMotor{&Run::motor_position_rad, "motor position", "rad", true};
constexpr Kind kTension{&Run::tension_N, "tension", "N", true};
constexpr Kind kTip{&Run::tip_m, "tip position", "m", false};
constexpr Kind kDirection{&Run::tip_quaternion, "tip orientation", "", false};
constexpr Kind kBending{&Run::bending_rad, "bending", "rad", false};
constexpr Kind kKinds[] = {kTarget, kActual, kMotor, kTension, kTip, kDirection, kBending};

constexpr Kind kLoads[] = {kActual, kTension};

std::string ChannelOf(const Kind& kind, Eigen::Index column) {
  return kind.a_tendon ? fmt::format("{} {}", kind.name, column + 1) : std::string(kind.name);
}

class Checkup {
 public:
  explicit Checkup(const DataSet& set) : set_(set), robot_(set.robot) {}

  std::vector<HealthFinding> All() {
    // Losses on reading come before advice on recording.
    for (const std::string& note : set_.notes) Add(Severity::kWarning, "", "files", 0, note);
    for (const Run& run : set_.runs) {
      for (const std::string& warning : run.warnings) Add(Severity::kWarning, run.name, "file", 0, warning);
    }
    WholeSet();
    for (const Run& run : set_.runs) {
      run_ = &run;
      if (run.time_s.size() < 2) continue;
      for (const std::string& note : run.notes) Add(Severity::kInfo, run.name, "file", 0, note);
      Sampling();
      for (const Kind& kind : kKinds) {
        if (!Fits(kind)) continue;
        Missing(kind);
        Constant(kind);
      }
      for (const Kind& kind : {kActual, kTension, kTip}) {
        if (Fits(kind)) Clipped(kind);
      }
      Saturated();
      Steps();
      Smoothed();
      Units();
      Signs();
      Rest();
      Excitation();
      Pairing(kTarget, kActual);
      Pairing(kActual, kTension);
      Pairing(kMotor, kTension);
      TrackerClock();
      Repetition();
    }
    return std::move(found_);
  }

 private:
  const Matrix& Of(const Kind& kind) const { return run_->*kind.matrix; }
  /// Measured, with one row per sample.
  bool Fits(const Kind& kind) const { return Of(kind).cols() > 0 && Of(kind).rows() == run_->time_s.size(); }

  void Add(Severity severity, const std::string& run, const std::string& channel, double value,
           std::string text) {
    found_.push_back({severity, run, channel, std::isfinite(value) ? value : 0, std::move(text)});
  }
  void Add(Severity severity, const std::string& channel, double value, std::string text) {
    Add(severity, run_->name, channel, value, std::move(text));
  }

  // ---- the set ----

  void WholeSet() {
    std::set<std::string> families;
    bool repeats = false, tip = false, tension = false, torque = false, motor = false;
    double tension_range = 0, reversals = 0;
    for (const Run& run : set_.runs) {
      families.insert(run.family);
      repeats = repeats || !run.repeat_of.empty();
      tip = tip || run.tip_m.cols() > 0 || run.bending_rad.cols() > 0 || run.tip_quaternion.cols() > 0;
      tension = tension || run.tension_N.array().isFinite().any();
      torque = torque || run.torque_actual_Nm.cols() > 0;
      motor = motor || run.motor_position_rad.cols() > 0;
      run_ = &run;
      if (Fits(kTension)) {
        for (Eigen::Index j = 0; j < run.tension_N.cols(); ++j) {
          tension_range = std::max(tension_range, RangeOf(run.tension_N.col(j)).width());
        }
      }
      if (Fits(kMotor)) {
        for (Eigen::Index j = 0; j < run.motor_position_rad.cols(); ++j) {
          reversals = std::max(reversals, 1.0 * Reversals(run.motor_position_rad.col(j)));
        }
      }
    }
    const auto lacks = [&](bool there, const char* channel, const char* text) {
      if (!there) Add(Severity::kWarning, "", channel, 0, text);
    };
    lacks(
        tip, "tip position",
        "no run has a tip; the shape and the motion of the body (C4, C5) cannot be compared; add a tracker");
    lacks(tension, "tension",
          "no run has tensions; motors, pulleys and tendons (C2, C3) cannot be told apart; add a load cell");
    lacks(torque, "actual torque",
          "no run has actual torques; the current loop and the drivetrain (C1, C2) cannot be compared; log "
          "the drives' actual torque or current");
    lacks(motor, "motor position",
          "no run has motor positions; tendons and drivetrain (C2, C3) cannot be compared; log the encoders");
    lacks(repeats, "repetitions",
          "no run repeats another; the noise floor is taken from fast differences, which do not include "
          "imperfect repeatability; repeat at least one run unchanged and declare it by repeat_of");
    if (families.size() < 2) {
      Add(Severity::kWarning, "", "families", static_cast<double>(families.size()),
          "all runs are of one family; no family can be held out, so a cause cannot be tested on another "
          "kind of motion; record another family and name the families in runs.yaml");
    }
    if (tension && tension_range < 0.5) {
      Add(Severity::kWarning, "", "tension", tension_range,
          fmt::format("no tension changes by more than {:.2g} N over all runs; effects that grow with "
                      "tension cannot be told from those that do not; pull harder",
                      tension_range));
    }
    if (motor && reversals < 2) {
      Add(Severity::kWarning, "", "motor position", reversals,
          "no motor reverses twice in any run; friction, backlash and hysteresis cannot be told from wrong "
          "gains; record slow triangles");
    }
  }

  // ---- sampling ----

  void Sampling() {
    const Eigen::VectorXd& t = run_->time_s;
    TimeSteps s = StepsOf(t);
    // Time stamps that scatter by more than a step define no grid in which rows could be missing.
    if (s.gaps > t.size() / 5) s.gaps = 0, s.lost = 0;
    Add(Severity::kInfo, "time", 1 / s.usual,
        fmt::format(
            "{} samples over {:.6g} s, {:.6g} Hz, jitter {:.3g} % of a step, {} gaps ({:.0f} rows missing)",
            t.size(), t[t.size() - 1] - t[0], 1 / s.usual, 100 * s.jitter / s.usual, s.gaps, s.lost));
    if (s.jitter > 0.2 * s.usual) {
      Add(Severity::kWarning, "time", s.jitter,
          fmt::format("steps scatter by {:.2g} s around {:.4g} s; fast effects (delay, damping) are blurred; "
                      "stamp the "
                      "samples where they are taken",
                      s.jitter, s.usual));
    }
    // Missing rows do not matter where nothing moves between rows.
    if (s.usual < kQuasiStatic_s && s.lost > 0.001 * static_cast<double>(t.size())) {
      Add(s.lost > 0.1 * static_cast<double>(t.size()) ? Severity::kError : Severity::kWarning, "time",
          s.lost,
          fmt::format("{:.0f} of {:.0f} rows are missing in {} gaps; the gaps and the time just after are "
                      "masked; record with less load on the logger",
                      s.lost, s.lost + static_cast<double>(t.size()), s.gaps));
    }
    if (s.usual > 0.9) {
      Add(Severity::kWarning, "time", s.usual,
          fmt::format("a step is {:.3g} s; if the column is in milliseconds divide it by 1000, else the run "
                      "is quasi-static and motion (C5) cannot be compared",
                      s.usual));
    } else if (s.usual > 0.02) {
      Add(Severity::kWarning, "time", 1 / s.usual,
          fmt::format("{:.3g} Hz; drives (C1) and motion (C5) need 100 Hz or more, the other cuts do not",
                      1 / s.usual));
    } else if (s.usual < 2e-5) {
      Add(Severity::kWarning, "time", s.usual,
          fmt::format("a step is {:.3g} s; is the column in another unit than seconds?", s.usual));
    }
    if (t[t.size() - 1] - t[0] < 2) {
      Add(Severity::kWarning, "time", t[t.size() - 1] - t[0],
          fmt::format(
              "{:.3g} s is short; slow effects and averages over noise cannot be determined; record longer",
              t[t.size() - 1] - t[0]));
    }
  }

  void Missing(const Kind& kind) {
    const Matrix& m = Of(kind);
    for (Eigen::Index c = 0; c < m.cols(); ++c) {
      const std::vector<Eigen::Index> rows = FiniteRows(m.col(c));
      const double missing = 1 - static_cast<double>(rows.size()) / static_cast<double>(m.rows());
      if (rows.empty()) {
        Add(Severity::kWarning, ChannelOf(kind, c), 1,
            "has no value at all; cuts that need it cannot be compared for this tendon or axis; check sensor "
            "and column");
      } else if (missing > 0.01) {
        // A slower sensor has its own regular grid: only values missing from that grid count.
        const double lost = LostOfOwnGrid(rows);
        if (lost > 0.02) {
          Add(lost > 0.3 ? Severity::kError : Severity::kWarning, ChannelOf(kind, c), lost,
              fmt::format(
                  "{:.1f} % of its values are missing; these stretches are not used; check cable and marker "
                  "visibility",
                  100 * lost));
        }
      }
      if (!kind.a_tendon) break;  // the axes of a pose are present or missing together
    }
  }

  void Constant(const Kind& kind) {
    const Matrix& m = Of(kind);
    for (Eigen::Index c = 0; c < m.cols(); ++c) {
      const Range range = RangeOf(m.col(c));
      if (range.count < 20 || range.width() > 0) continue;
      // A target may stay constant, and so may a simulated tip; a motor is suspicious only if its load
      // changes.
      const bool cell = kind.matrix == &Run::tension_N || kind.matrix == &Run::torque_actual_Nm;
      const bool motor = kind.matrix == &Run::motor_position_rad && LoadChanges(c);
      if (!cell && !motor) continue;
      Add(Severity::kWarning, ChannelOf(kind, c), range.least,
          fmt::format("is {:.6g} {} throughout; a dead sensor carries no information and looks like a "
                      "perfect one; check its cable and its column",
                      range.least, kind.unit));
    }
  }

  bool LoadChanges(Eigen::Index tendon) const {
    return std::any_of(std::begin(kLoads), std::end(kLoads), [&](const Kind& load) {
      if (!Fits(load) || Of(load).cols() <= tendon) return false;
      const auto column = Of(load).col(tendon);
      return RangeOf(column).width() > 50 * Scatter(column) && RangeOf(column).width() > 0;
    });
  }

  // ---- amplitudes ----

  void Clipped(const Kind& kind) {
    const Matrix& m = Of(kind);
    for (Eigen::Index c = 0; c < m.cols(); ++c) {
      for (const bool top : {true, false}) {
        const Plateau p = FlatExtreme(m.col(c), top);
        if (p.share < 0.003) continue;
        Add(p.share > 0.1 ? Severity::kError : Severity::kWarning, ChannelOf(kind, c), p.share,
            fmt::format("is clipped at {:.6g} {} for {:.1f} % of the run{}; use a sensor with a larger range "
                        "or a smaller motion",
                        p.value, kind.unit, 100 * p.share,
                        kind.matrix == &Run::torque_actual_Nm
                            ? ": the end of the reading's range, or of the drive's"
                            : "; clipped values say nothing about the robot"));
      }
    }
  }

  void Saturated() {
    if (!robot_.actuation || !Fits(kTarget)) return;
    const Matrix& m = Of(kTarget);
    for (Eigen::Index j = 0; j < std::min<Eigen::Index>(m.cols(), Tendons()); ++j) {
      const auto& t = robot_.actuation->tendons[static_cast<std::size_t>(j)];
      const double most = t.motor.torque_constant_NmpA * t.drive.current_limit_A;
      if (!(most > 0)) continue;
      const double share = static_cast<double>((m.col(j).array().abs() >= 0.995 * most).count()) /
                           static_cast<double>(m.rows());
      // Values far beyond the limit indicate a wrong unit.
      if (share < 0.002 || m.col(j).array().isNaN().select(0, m.col(j)).cwiseAbs().maxCoeff() > 5 * most)
        continue;
      Add(Severity::kWarning, ChannelOf(kTarget, j), share,
          fmt::format(
              "is at the drive's limit of {:.4g} N m for {:.1f} % of the run; the drive cannot follow there; "
              "plan a smaller motion",
              most, 100 * share));
    }
  }

  // ---- steps of the numbers ----

  void Steps() {
    if (!robot_.actuation) return;
    const auto check = [&](const Kind& kind, auto expected, const char* key) {
      if (!Fits(kind)) return;
      const Matrix& m = Of(kind);
      for (Eigen::Index j = 0; j < std::min<Eigen::Index>(m.cols(), Tendons()); ++j) {
        const auto& tendon = robot_.actuation->tendons[static_cast<std::size_t>(j)];
        const double step = Quantum(m.col(j));
        const double by_file = expected(tendon);
        if (!(step > 0) || !(by_file > 0)) continue;
        const double ratio = step / by_file;
        if (std::abs(ratio - 1) < 0.02) continue;
        // Values that differ only by several steps are coarser than the file says, not in another unit.
        Add(ratio < 0.98 && kind.matrix == &Run::motor_position_rad ? Severity::kWarning : Severity::kInfo,
            ChannelOf(kind, j), step,
            fmt::format("comes in steps of {:.6g} {}, but {:.6g} by the robot file ({:.4g} times); {} may be "
                        "another robot's; check it",
                        step, kind.unit, by_file, ratio, key));
      }
    };
    check(
        kMotor, [](const auto& t) { return 2 * kPi / t.drive.encoder_counts_per_turn; },
        "actuation.drive.encoder_counts_per_turn");
    check(
        kActual, [](const auto& t) { return 1e-3 * t.drive.rated_torque_Nm; },
        "actuation.drive.rated_torque_Nm");
    check(
        kTension,
        [](const auto& t) {
          return t.load_cell.gain_VpN > 0 ? t.load_cell.resolution_V / t.load_cell.gain_VpN : 0;
        },
        "actuation.load_cell.gain_VpN or resolution_V");
  }

  // A sensor is as noisy as its data sheet says; with less noise, its readings were filtered and fast changes
  // are missing too.
  void Smoothed() {
    constexpr double kLess = 0.1, kSteps = 0.3;
    if (!robot_.actuation || StepsOf(run_->time_s).usual > kQuasiStatic_s) return;
    const auto check = [&](const Kind& kind, Eigen::Index column, double noise) {
      const auto x = Of(kind).col(column);
      if (!(noise > 0) || RangeOf(x).count < 100 || RangeOf(x).width() <= 0 || Quantum(x) > kSteps * noise)
        return;
      const double scatter = Scatter(x);
      if (scatter > kLess * noise) return;
      Add(Severity::kWarning, ChannelOf(kind, column), scatter,
          fmt::format("scatters by {:.2g} {} from value to value, but {:.2g} by the robot file: filtered, "
                      "averaged, interpolated or repeated before logging; fast changes may be missing, which "
                      "looks like a gap; log the sensor's raw readings",
                      scatter, kind.unit, noise));
    };
    if (Fits(kTension)) {
      for (Eigen::Index j = 0; j < std::min(Of(kTension).cols(), Tendons()); ++j) {
        const auto& cell = robot_.actuation->tendons[static_cast<std::size_t>(j)].load_cell;
        const double step_N = cell.gain_VpN > 0 ? cell.resolution_V / cell.gain_VpN : 0;
        check(kTension, j, std::hypot(cell.noise_N, step_N / std::sqrt(12.0)));
      }
    }
    if (Fits(kTip) && robot_.actuation->tracker) check(kTip, 0, robot_.actuation->tracker->position_noise_m);
  }

  // ---- units ----

  /// Largest magnitude except for the rarest values, which do not indicate a unit.
  static double Usual(const Matrix& m) {
    std::vector<double> sizes;
    for (const double x : m.reshaped()) {
      if (std::isfinite(x)) sizes.push_back(std::abs(x));
    }
    return sizes.empty() ? 0 : Quantile(std::move(sizes), 0.98);
  }

  void Units() {
    if (Fits(kTip)) TipUnits();
    if (Fits(kBending)) {
      const double most = Largest(Of(kBending));
      if (most > 2 * kPi) {
        Add(Severity::kError, kBending.name, most,
            fmt::format("reaches {:.4g} rad; a section cannot bend that far; are these degrees?", most));
      }
    }
    if (!robot_.actuation) return;
    const auto& t = robot_.actuation->tendons.front();
    const LimitParameters& limits = robot_.limits;
    UnitsBy(kTension, Usual(Of(kTension)), limits.max_tension_motor_N, limits.min_tension_N / 30,
            {{"millinewtons", 1e-3},
             {"grams", 9.81e-3},
             {"kilonewtons", 1e3},
             {"volts of the cell", t.load_cell.gain_VpN > 0 ? 1 / t.load_cell.gain_VpN : 0}});
    const double rated_Nm = t.drive.rated_torque_Nm;
    for (const Kind& kind : {kTarget, kActual}) {
      UnitsBy(kind, Usual(Of(kind)), rated_Nm, 1e-4 * rated_Nm,
              {{"millinewton metres", 1e-3},
               {"amperes", t.motor.torque_constant_NmpA},
               {"milliamperes", 1e-3 * t.motor.torque_constant_NmpA},
               {"per mille of rated torque", 1e-3 * rated_Nm}});
    }
    const double most_rad = MostMotorWay_rad(robot_);
    if (!(most_rad > 0) || t.drive.encoder_counts_per_turn <= 0) return;
    Matrix position_rad = Of(kMotor);
    for (auto motor : position_rad.colwise()) {
      for (const Eigen::Index i : LonePositions(motor, robot_)) motor[i] = std::nan("");
    }
    UnitsBy(kMotor, Range::Of(position_rad).width(), most_rad, 1e-4 * most_rad,
            {{"degrees", kPi / 180}, {"encoder counts", 2 * kPi / t.drive.encoder_counts_per_turn}});
  }

  /// Reports a channel whose range is far from the robot's; of the candidate units, names the one that brings
  /// it nearest to the middle of the usual range.
  void UnitsBy(const Kind& kind, double reached, double most, double least,
               const std::vector<std::pair<const char*, double>>& units) {
    if (!Fits(kind) || !(most > 0) || !(reached > 0)) return;
    if (reached < 6 * most && reached > least) return;
    const auto off = [&](double factor) { return std::abs(std::log(reached * factor / (0.3 * most))); };
    const auto best = std::min_element(units.begin(), units.end(), [&](const auto& a, const auto& b) {
      return b.second <= 0 || (a.second > 0 && off(a.second) < off(b.second));
    });
    const std::string hint =
        best->second > 0 && off(best->second) < off(1)
            ? fmt::format("are these {}? convert them (tendril gap import has a column map for it)",
                          best->first)
            : "check the column and the robot file";
    const bool motor = kind.matrix == &Run::motor_position_rad;
    const char* so = reached > most && !motor ? "values that this robot cannot reach are masked"
                                              : "wrong units make every number of the diagnosis wrong";
    Add(Severity::kError, kind.name, reached,
        fmt::format("reaches {:.4g} {}, but this robot reaches {:.4g} at most; {}; {}", reached, kind.unit,
                    most, so, hint));
  }

  void TipUnits() {
    const double length_m = robot_.body.length_m();
    std::vector<double> distance;
    const Matrix& tip = Of(kTip);
    for (Eigen::Index i = 0; i < tip.rows(); ++i) {
      if (const double d = tip.row(i).norm(); std::isfinite(d)) distance.push_back(d);
    }
    if (distance.empty()) return;
    const double usual = Quantile(distance, 0.5), far = Quantile(distance, 0.99);
    if (usual > 30 * length_m) {
      const bool mm = usual / 1000 > 0.2 * length_m && usual / 1000 < 3 * length_m;
      Add(Severity::kError, kTip.name, usual,
          fmt::format("is {:.4g} m from the base, the robot is {:.4g} m long; {}", usual, length_m,
                      mm ? "these are millimetres; divide by 1000"
                         : "wrong unit or the tracker's own origin; give it in metres in the base's frame"));
    } else if (const double rest = distance.front(); rest < 0.3 * length_m) {
      Add(Severity::kError, kTip.name, rest,
          fmt::format("begins {:.4g} m from the base, the robot is {:.4g} m long; is the tip given as a "
                      "displacement or in "
                      "another unit? give its position in metres in the base's frame",
                      rest, length_m));
    } else if (far > 1.05 * length_m + 0.002) {
      Add(Severity::kWarning, kTip.name, far,
          fmt::format(
              "is up to {:.4g} m from the base, the robot is {:.4g} m long; a frame with another origin, or "
              "the file of another robot, looks like a gap; transform the tracker's frame to the base",
              far, length_m));
    } else if (far < kNearest * length_m) {
      Add(Severity::kWarning, kTip.name, far,
          fmt::format(
              "is never more than {:.4g} m from the base, the robot is {:.4g} m long; the file of a "
              "longer robot looks like a gap; give the file of the robot that was measured, unless it "
              "was strongly bent all the time",
              far, length_m));
    }
  }

  void Signs() {
    if (!Fits(kTension)) return;
    const Matrix& m = Of(kTension);
    for (Eigen::Index j = 0; j < m.cols(); ++j) {
      const auto rows = FiniteRows(m.col(j));
      if (rows.empty()) continue;
      const double noise = std::max(Scatter(m.col(j)), 1e-3);
      const auto below = static_cast<double>(std::count_if(
          rows.begin(), rows.end(), [&](Eigen::Index i) { return m(i, j) < -5 * noise - 0.02; }));
      const double share = below / static_cast<double>(rows.size());
      if (share > 0.9) {
        Add(Severity::kError, ChannelOf(kTension, j), share,
            "is negative throughout; a tendon can only pull; reverse its sign (pulling is positive)");
      } else if (share > 0.001) {
        Add(Severity::kWarning, ChannelOf(kTension, j), RangeOf(m.col(j)).least,
            fmt::format("falls to {:.3g} N; a tendon cannot push, so the cell has an offset; zero the cells "
                        "with slack tendons before the run",
                        RangeOf(m.col(j)).least));
      }
    }
  }

  // ---- beginning and excitation ----

  void Rest() {
    const Eigen::VectorXd& t = run_->time_s;
    const auto rest =
        static_cast<Eigen::Index>(std::upper_bound(t.data(), t.data() + t.size(), t[0] + kRest_s) - t.data());
    if (rest < 5 || rest == t.size() || StepsOf(t).usual > kQuasiStatic_s) return;
    double worst = 0;
    std::string channel;
    for (const Kind& kind : {kMotor, kTension, kTip}) {
      if (!Fits(kind)) continue;
      const Matrix& m = Of(kind);
      for (Eigen::Index c = 0; c < m.cols(); ++c) {
        const double whole = RangeOf(m.col(c)).width();
        const double noise = Scatter(m.col(c).head(rest));
        const double moved = std::max(RangeOf(m.col(c).head(rest)).width() - 8 * noise, 0.0);
        if (whole <= 0 || whole < 20 * noise || moved / whole < worst) continue;
        worst = moved / whole;
        channel = ChannelOf(kind, c);
      }
    }
    if (worst < 0.05) return;
    Add(Severity::kWarning, channel, worst,
        fmt::format("moves by {:.0f} % of its range in the first {} s; the initial state is therefore "
                    "unknown; begin runs straight, at pretension and at rest",
                    100 * worst, kRest_s));
  }

  void Excitation() {
    std::string text;
    double value = 0;
    if (Fits(kTension)) {
      text += "tension ranges";
      for (Eigen::Index j = 0; j < run_->tension_N.cols(); ++j) {
        const double width = RangeOf(run_->tension_N.col(j)).width();
        value = std::max(value, width);
        text += fmt::format(" {:.3g}", width);
      }
      text += " N";
    }
    if (Fits(kMotor)) {
      int reversals = 0;
      double slow = 0, fast = 0;
      for (Eigen::Index j = 0; j < run_->motor_position_rad.cols(); ++j) {
        reversals += Reversals(run_->motor_position_rad.col(j));
        const auto [lower, upper] = Speeds(run_->time_s, run_->motor_position_rad.col(j));
        if (upper > fast) fast = upper, slow = lower;
      }
      text += fmt::format("{}{} reversals, motor speed {:.3g} to {:.3g} rad/s", text.empty() ? "" : ", ",
                          reversals, slow, fast);
    }
    if (const double bend = BendRange(); bend >= 0) {
      text += fmt::format("{}tip turns by up to {:.3g} rad", text.empty() ? "" : ", ", bend);
    }
    if (!text.empty()) Add(Severity::kInfo, "excitation", value, text);
  }

  /// Largest angle of the tip's axis from its first direction; negative without orientation.
  double BendRange() const {
    if (!Fits(kDirection)) return -1;
    const Matrix& q = Of(kDirection);
    Eigen::Vector3d first = Eigen::Vector3d::Zero();
    double most = -1;
    for (Eigen::Index i = 0; i < q.rows(); ++i) {
      if (!q.row(i).allFinite()) continue;
      const double w = q(i, 0), x = q(i, 1), y = q(i, 2), z = q(i, 3);
      const Eigen::Vector3d axis(2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y));
      if (most < 0) first = axis, most = 0;
      most = std::max(most, std::acos(std::clamp(first.dot(axis), -1.0, 1.0)));
    }
    return most;
  }

  // ---- order and sign ----

  // Two signals of the same tendon rise and fall together. When several signals correlate far better with
  // another tendon than with their own, columns are exchanged; if that other tendon also correlates with its
  // own signal, the motion itself may be the reason.
  void Pairing(const Kind& from, const Kind& to) {
    if (!Fits(from) || !Fits(to)) return;
    const Eigen::Index n = std::min(Of(from).cols(), Of(to).cols());
    const Matrix c = ChangeCorrelation(run_->time_s, Of(from).leftCols(n), Of(to).leftCols(n));
    constexpr double kSurely = 0.95;
    const auto followed = [&](Eigen::Index j) {
      Eigen::Index best = j;
      for (Eigen::Index i = 0; i < n; ++i) {
        if (c(i, j) > c(best, j)) best = i;
      }
      return best;
    };
    for (Eigen::Index j = 0; j < n; ++j) {
      if (!std::isfinite(c(j, j))) continue;
      const Eigen::Index best = followed(j);
      Eigen::Index back = j;
      for (Eigen::Index i = 0; i < n; ++i) {
        if (c(j, i) > c(j, back)) back = i;
      }
      const bool has_its_own = followed(best) == best && std::isfinite(c(best, best));
      if (best != j && back != j && c(best, j) > (has_its_own ? kSurely : 0.7) &&
          c(best, j) - c(j, j) > 0.4) {
        Add(Severity::kError, ChannelOf(to, j), c(j, j),
            fmt::format("follows the {} of tendon {} (correlation {:.2f}), not its own ({:.2f}); the columns "
                        "are in another order than the tendons, so causes would be attributed to the wrong "
                        "tendons; exchange them",
                        from.name, best + 1, c(best, j), c(j, j)));
      } else if (c(j, j) < -0.8 && (n == 1 || c(best, j) < 0.7)) {
        Add(Severity::kError, ChannelOf(to, j), c(j, j),
            fmt::format("falls when the {} of its tendon rises (correlation {:.2f}); one of the two has the "
                        "wrong sign; "
                        "pulling is positive for both",
                        from.name, c(j, j)));
      }
    }
  }

  // ---- clocks ----

  void TrackerClock() {
    if (!Fits(kMotor) || !Fits(kTip)) return;
    const auto shift = ClockShift(run_->time_s, Of(kMotor), Of(kTip));
    if (!shift) return;
    const double file_delay_s =
        set_.robot.actuation && set_.robot.actuation->tracker ? set_.robot.actuation->tracker->delay_s : 0;
    const double unknown_s = shift->seconds - file_delay_s;
    // A damped body lags its tensions by about its damping over its stiffness, which grows with its size.
    double own_s = 0;
    for (const SectionParameters& s : set_.robot.body.sections)
      own_s = std::max(own_s, s.bending_damping_Nms / s.UnitStiffness());
    const double most_s = std::max(0.015, 3 * own_s), resolved_s = 2 * StepsOf(run_->time_s).usual;
    const bool odd = unknown_s < -std::max(0.015, resolved_s) || unknown_s > std::max(most_s, resolved_s);
    Add(odd ? Severity::kWarning : Severity::kInfo, "tracker clock", shift->seconds,
        fmt::format("the tip follows the motors {:.1f} ms {} (correlation {:.3f}){}",
                    1e3 * std::abs(shift->seconds), shift->seconds < 0 ? "too early" : "later",
                    shift->correlation,
                    unknown_s < -0.015 ? "; no robot does, so the clocks differ; synchronise them"
                    : unknown_s > most_s
                        ? "; more than the usual lag of the body: a robot that is softer, heavier or more "
                          "damped than its file says, clocks that differ, or a slow tracker; synchronise the "
                          "clocks, or give the tracker's delay_s in the robot file"
                        : ""));
  }

  // ---- repetitions ----

  void Repetition() {
    if (run_->repeat_of.empty()) return;
    const auto original = std::find_if(set_.runs.begin(), set_.runs.end(),
                                       [&](const Run& r) { return r.name == run_->repeat_of; });
    if (original == set_.runs.end()) return;
    for (const Kind& kind : {kActual, kMotor, kTension, kTip}) {
      const Matrix& theirs = (*original).*kind.matrix;
      if (!Fits(kind) || theirs.cols() != Of(kind).cols() || theirs.rows() != original->time_s.size())
        continue;
      const double rms = RmsDifference(run_->time_s, Of(kind), original->time_s, theirs);
      const double range = Range::Of(Of(kind)).width();
      if (!std::isfinite(rms)) continue;
      const bool poor = rms > 0.1 * range && range > 0 && rms > 3 * Scatter(Of(kind).col(0));
      Add(poor ? Severity::kWarning : Severity::kInfo, kind.name, rms,
          fmt::format("differs from {} by {:.3g} {} rms{}", original->name, rms, kind.unit,
                      poor ? "; this is not a repetition, and its differences would count as noise; check "
                             "that commands and beginning were the same (repeat_of in runs.yaml)"
                           : ", the floor below which no gap can be seen"));
    }
  }

  Eigen::Index Tendons() const { return static_cast<Eigen::Index>(robot_.actuation->tendons.size()); }

  const DataSet& set_;
  const RobotParameters& robot_;
  const Run* run_ = nullptr;
  std::vector<HealthFinding> found_;
};

}  // namespace

std::vector<HealthFinding> CheckHealth(const DataSet& set) { return Checkup(set).All(); }

}  // namespace tendril::gap
