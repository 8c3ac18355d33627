// Removes implausible samples, one function per kind.
#include "implausible.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <set>

#include "health_signal.h"
#include "leap.h"
#include "marker_errors.h"
#include "median.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

constexpr double kRare = 0.02;     // share of a column's values up to which they are isolated errors
constexpr double kBeyond = 3;      // times the robot's range
constexpr double kCutOff = 0.003;  // share of a run at the flat end of a channel
constexpr double kAround_s = 0.6 * kBridged_s;  // on either side: more in total than interpolation bridges
// A sensor is frozen that keeps one value for kFrozen_s while the motor turns by this share of its range in
// the run.
constexpr double kMoved = 0.15;
constexpr double kLoneWithin_s = 0.0025;  // from an isolated tension to its neighbours
constexpr double kCoarse = 0.01;          // of a channel's range: a table's resolution
constexpr double kGoesOn = 0.05;          // of the largest tension
constexpr double kFollows = 0.25;         // of the tension that a torque gives without friction
constexpr double kSlack = 0.5;            // of the pretension: below, a cell without noise may be constant
constexpr double kLonePosition = 0.05;    // of the motor's usual motion in the run
constexpr double kLoneTension = 0.1;      // of the tension's usual change in the run
constexpr double kLoneWay = 0.01;         // of the motor's travel from one limit to the other

/// Slope of the least-squares line of y over x; 0 for too few values.
double Slope(const std::vector<double>& x, const std::vector<double>& y) {
  const auto n = static_cast<Eigen::Index>(x.size());
  if (n < 2) return 0;
  const Eigen::ArrayXd dx = Eigen::Map<const Eigen::ArrayXd>(x.data(), n);
  const Eigen::ArrayXd dy = Eigen::Map<const Eigen::ArrayXd>(y.data(), n);
  const double square = (dx - dx.mean()).square().sum();
  return square > 0 ? ((dx - dx.mean()) * (dy - dy.mean())).sum() / square : 0;
}

/// Columns of one kind of signal, and those that lie beyond the robot's range.
struct Beyond {
  const char* unit;
  int columns = 0, left_out = 0;
  double worst = 0, most = 0;
};

struct Finder {
  Run& run;
  std::vector<std::string>& said;
  double slack_N;

  void Say(const std::string& channel, const std::string& text) {
    said.push_back(fmt::format("{}: {} {}", run.name, channel, text));
  }

  /// Values of column j with a magnitude above `most`.
  void OutOfRange(Eigen::MatrixXd& matrix, Eigen::Index j, const std::string& channel, double most,
                  Beyond& kind) {
    const char* unit = kind.unit;
    if (matrix.rows() != run.time_s.size() || !(most > 0)) return;
    Eigen::Index there = 0, beyond = 0;
    double worst = 0;
    for (const double x : matrix.col(j)) {
      there += std::isfinite(x);
      if (!(std::abs(x) > most)) continue;
      ++beyond;
      worst = std::max(worst, std::abs(x));
    }
    kind.columns += there > 0;
    if (beyond == 0) return;
    const bool rare = static_cast<double>(beyond) <= kRare * static_cast<double>(there);
    for (double& x : matrix.col(j)) {
      if (!rare || std::abs(x) > most) x = kNoReading;
    }
    if (rare) {
      Say(channel,
          fmt::format("has {} value{} up to {:.4g} {}, which this robot cannot reach: taken as missing",
                      beyond, beyond == 1 ? "" : "s", worst, unit));
    } else {
      ++kind.left_out;
      kind.worst = std::max(kind.worst, worst);
      kind.most = most;
      Say(channel,
          fmt::format(
              "reaches {:.4g} {} and is beyond this robot's range in {:.0f} % of its values: left out", worst,
              unit, 100.0 * static_cast<double>(beyond) / static_cast<double>(there)));
    }
  }

  /// Single-turn encoder: from one row to the next the angle jumps by a whole turn, apart from the usual
  /// motion between rows. It starts at the turn nearest to zero, as a robot at rest does.
  void Unwrap(Eigen::Index j) {
    constexpr double kTurn_rad = 2 * std::numbers::pi, kMost_rad = 0.25 * kTurn_rad;
    const auto x = run.motor_position_rad.col(j);
    if (RangeOf(x).width() > 1.001 * kTurn_rad) return;
    std::vector<std::pair<Eigen::Index, double>> jumps;  // row, and turns to add from there on
    Eigen::Index last = -1;
    double farthest_rad = 0, missing_rad = 0;  // largest step elsewhere; error of a jump as a turn
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      if (!std::isfinite(x[i])) continue;
      const double step_rad = last < 0 ? 0 : x[i] - x[last];
      if (std::abs(step_rad) <= kTurn_rad - kMost_rad) {
        farthest_rad = std::max(farthest_rad, std::abs(step_rad));
      } else {
        if (run.time_s[i] - run.time_s[last] > kBridged_s) return;
        missing_rad = std::max(missing_rad, kTurn_rad - std::abs(step_rad));
        jumps.emplace_back(i, step_rad > 0 ? -1 : 1);
      }
      last = i;
    }
    if (jumps.empty() || missing_rad > 2 * farthest_rad) return;
    auto motor = run.motor_position_rad.col(j);
    const auto first = std::find_if(motor.begin(), motor.end(), [](double v) { return std::isfinite(v); });
    const double turns = -std::round(*first / kTurn_rad);
    for (const auto& [row, turn] : jumps) motor.tail(motor.size() - row).array() += turn * kTurn_rad;
    motor.array() += turns * kTurn_rad;
    Say(fmt::format("motor position {}", j + 1),
        fmt::format("jumps by a turn {}, as a single-turn encoder does: unwrapped, starting within half a "
                    "turn of its zero",
                    jumps.size() == 1 ? "once" : fmt::format("{} times", jumps.size())));
  }

  /// A motion that no motor can make is an encoder error; one that only the file's motor cannot make
  /// indicates a wrong file.
  void LoneMotorPositions(Eigen::Index j, const RobotParameters& robot) {
    auto x = run.motor_position_rad.col(j);
    std::vector<Eigen::Index> rows;
    MotorLeap beyond;
    for (const MotorLeap& leap : MotorLeaps(run, j, robot, LonePositions(x, robot))) {
      if (leap.kind == MotorLeap::Kind::kEncoderError)
        rows.insert(rows.end(), leap.rows.begin(), leap.rows.end());
      if (leap.kind == MotorLeap::Kind::kExceedsFile && leap.needed_Nm > beyond.needed_Nm) beyond = leap;
    }
    if (beyond.needed_Nm > 0) SayTooWeak(j, beyond);
    if (rows.empty()) return;
    double worst = 0;
    for (const Eigen::Index i : rows) {
      if (std::abs(x[i]) > std::abs(worst)) worst = x[i];
      x[i] = kNoReading;
    }
    Say(fmt::format("motor position {}", j + 1),
        fmt::format("jumps to {:.4g} rad and back{}, first at {:.4g} s: taken as missing there", worst,
                    rows.size() == 1 ? "" : fmt::format(" and {} times more", rows.size() - 1),
                    run.time_s[rows.front()] - run.time_s[0]));
  }

  void SayTooWeak(Eigen::Index j, const MotorLeap& leap) {
    const std::string tendon =
        leap.tension_N == 0 ? ""
                            : fmt::format(", and its tension changes with it by {:.3g} N", leap.tension_N);
    Say(fmt::format("motor position {}", j + 1),
        fmt::format("leaves its path by {:.3g} rad and returns at {:.4g} s{}: kept; the file's motor is too "
                    "weak for this log: with its inertia (actuation.motor.rotor_inertia_kgm2) this takes at "
                    "least {:.3g} N m, and it has {:.3g} N m (actuation.drive.current_limit_A x "
                    "actuation.motor.torque_constant_NmpA); check these numbers",
                    leap.off_rad, run.time_s[leap.farthest] - run.time_s[0], tendon, leap.needed_Nm,
                    leap.file_Nm));
  }

  /// A cell that shows an outlier in a single row, such as a code for no reading.
  void LoneTensions(Eigen::Index j, const RobotParameters& robot) {
    auto x = run.tension_N.col(j);
    // Between distant readings a tension may have risen and returned.
    if (Median(RowsApart(x)) * UsualStep(run) > kLoneWithin_s) return;
    const std::vector<Eigen::Index> rows = TensionsAlone(
        run, j, robot, LoneValues(x, std::max(kLoneTension * UsualWidth({x.begin(), x.end()}), slack_N)));
    if (rows.empty()) return;
    const double first_N = x[rows.front()];
    for (const Eigen::Index i : rows) x[i] = kNoReading;
    Say(fmt::format("tension {}", j + 1),
        fmt::format("jumps to {:.4g} N and back{}, first at {:.4g} s: taken as missing there", first_N,
                    rows.size() == 1 ? "" : fmt::format(" and {} times more", rows.size() - 1),
                    run.time_s[rows.front()] - run.time_s[0]));
  }

  /// Calls with rows [from, to) of intervals in which `same(i)` says that row i repeats the previous reading.
  template <class There, class Same, class Found>
  void Stretches(There&& there, Same&& same, Found&& found) {
    const Eigen::Index rows = run.time_s.size();
    Eigen::Index from = -1, last = -1;
    const auto end = [&](Eigen::Index to) {
      if (from >= 0 && last > from && run.time_s[last] - run.time_s[from] >= kFrozen_s) found(from, to);
    };
    for (Eigen::Index i = 0; i < rows; ++i) {
      if (!there(i)) continue;
      if (last < 0 || !same(i, last)) {
        end(last + 1);
        from = i;
      }
      last = i;
    }
    end(last + 1);
  }

  /// Share of motor j's motion in the run that happens within rows [from, to).
  double Moved(Eigen::Index j, Eigen::Index from, Eigen::Index to) const {
    if (j >= run.motor_position_rad.cols()) return 0;
    const auto x = run.motor_position_rad.col(j);
    const double all = RangeOf(x).width();
    return all > 0 ? RangeOf(x.segment(from, to - from)).width() / all : 0;
  }

  std::string Span(Eigen::Index from, Eigen::Index to) const {
    return fmt::format("from {:.4g} s to {:.4g} s", run.time_s[from] - run.time_s[0],
                       run.time_s[to - 1] - run.time_s[0]);
  }

  /// Removes neighbours as well, so that no interpolation covers clipped samples.
  void TakeOutAround(Eigen::Ref<Eigen::VectorXd> x, const std::vector<double>& at_s) {
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      const auto next = std::lower_bound(at_s.begin(), at_s.end(), run.time_s[i] - kAround_s);
      if (next != at_s.end() && *next <= run.time_s[i] + kAround_s) x[i] = kNoReading;
    }
  }

  /// A sensor at the end of its range shows less than the true value.
  void CutOff(Eigen::MatrixXd& matrix, Eigen::Index j, const std::string& channel, const char* unit) {
    for (const bool top : {true, false}) {
      const Plateau end = FlatExtreme(matrix.col(j), top);
      // A slack tendon's cell may well show zero.
      if (end.share < kCutOff || (&matrix == &run.tension_N && std::abs(end.value) < slack_N)) continue;
      std::vector<double> at_s;
      for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
        if (matrix(i, j) == end.value) at_s.push_back(run.time_s[i]);
      }
      TakeOutAround(matrix.col(j), at_s);
      Say(channel, fmt::format("is clipped at {:.4g} {} for {:.1f} % of the run: taken as missing there",
                               end.value, unit, 100 * end.share));
    }
  }

  /// The limit of motor j's reported torque in this run, upwards or downwards: the reading stays constant
  /// while more is commanded and the tension follows the command. A limit of the motor itself is a property
  /// of the robot and stays in the data.
  std::optional<double> ReadingEnds(Eigen::Index j, bool top, const RobotParameters& robot) const {
    const auto x = run.torque_actual_Nm.col(j);
    const Eigen::Index known =
        robot.actuation ? static_cast<Eigen::Index>(robot.actuation->tendons.size()) : 0;
    if (j >= std::min({known, run.torque_target_Nm.cols(), run.tension_N.cols()})) return {};
    const double travel_m = robot.actuation->tendons[static_cast<std::size_t>(j)].SpoolTravelPerMotorRad();
    const Plateau end = FlatExtreme(x, top);
    if (end.share < kCutOff) return {};
    Eigen::Index flat = 0, asked = 0;
    std::vector<double> target_Nm, tension_N;
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      if (x[i] != end.value) continue;
      const double more = (run.torque_target_Nm(i, j) - end.value) * (top ? 1 : -1);
      ++flat;
      asked += more > 0.02 * std::abs(end.value);
      if (!std::isfinite(more + run.tension_N(i, j))) continue;
      target_Nm.push_back(run.torque_target_Nm(i, j));
      tension_N.push_back(run.tension_N(i, j));
    }
    // Other tendons change the tension as well.
    const double follows = Slope(target_Nm, tension_N) * travel_m;
    if (2 * asked < flat || UsualWidth(std::move(tension_N)) < kGoesOn * robot.limits.max_tension_motor_N ||
        follows < kFollows)
      return {};
    return end.value;
  }

  /// Removes readings at the limit found in any run.
  void TorqueCutOff(Eigen::Index j, bool top, const std::set<double>& ends_Nm) {
    auto x = run.torque_actual_Nm.col(j);
    const Plateau end = FlatExtreme(x, top);
    if (end.share <= 0 || !ends_Nm.contains(end.value)) return;
    for (double& value : x) {
      if (value == end.value) value = kNoReading;
    }
    Say(fmt::format("actual torque {}", j + 1),
        fmt::format("is clipped at {:.4g} N m for {:.2g} % of the run while its tension still changes: taken "
                    "as missing there",
                    end.value, 100 * end.share));
  }

  void FrozenCell(Eigen::Index j) {
    auto x = run.tension_N.col(j);
    Stretches([&](Eigen::Index i) { return std::isfinite(x[i]); },
              [&](Eigen::Index i, Eigen::Index before) { return x[i] == x[before]; },
              [&](Eigen::Index from, Eigen::Index to) {
                if (std::abs(x[from]) < slack_N || Moved(j, from, to) < kMoved) return;
                Say(fmt::format("tension {}", j + 1),
                    fmt::format("stays at {:.4g} N {} while the motor turns: taken as missing there", x[from],
                                Span(from, to)));
                TakeOutAround(x, {run.time_s.begin() + from, run.time_s.begin() + to});
              });
  }

  void FrozenTip() {
    auto& x = run.tip_m;
    Stretches([&](Eigen::Index i) { return x.row(i).allFinite(); },
              [&](Eigen::Index i, Eigen::Index before) { return x.row(i) == x.row(before); },
              [&](Eigen::Index from, Eigen::Index to) {
                double moved = 0;
                for (Eigen::Index j = 0; j < run.motor_position_rad.cols(); ++j)
                  moved = std::max(moved, Moved(j, from, to));
                if (moved < kMoved) return;
                Say("the tip", fmt::format("does not move {} while motors turn: taken as missing there",
                                           Span(from, to)));
                x.middleRows(from, to - from).setConstant(kNoReading);
              });
  }
};

/// A drive's reported torque is limited at the same value in every run, even where the tension does not show
/// it.
void TakeOutTorquesCutOff(DataSet& set, std::vector<std::string>& said) {
  const double slack_N = kSlack * set.robot.limits.min_tension_N;
  for (const bool top : {true, false}) {
    std::map<Eigen::Index, std::set<double>> ends_Nm;  // by tendon
    const auto each = [&](auto&& call) {
      for (Run& run : set.runs) {
        if (run.torque_actual_Nm.rows() != run.time_s.size()) continue;
        for (Eigen::Index j = 0; j < run.torque_actual_Nm.cols(); ++j) call(Finder{run, said, slack_N}, j);
      }
    };
    each([&](const Finder& find, Eigen::Index j) {
      if (const auto end_Nm = find.ReadingEnds(j, top, set.robot)) ends_Nm[j].insert(*end_Nm);
    });
    each([&](Finder find, Eigen::Index j) { find.TorqueCutOff(j, top, ends_Nm[j]); });
  }
}

}  // namespace

double MostMotorWay_rad(const RobotParameters& robot) {
  if (!robot.actuation) return 0;
  double radius_m = 0;
  for (const auto& section : robot.body.sections) {
    for (const auto& route : section.tendons) radius_m = std::max(radius_m, route.radius_m);
  }
  const double travel_m = robot.actuation->tendons.front().SpoolTravelPerMotorRad();
  const auto sections = static_cast<double>(robot.body.sections.size());
  return travel_m > 0 ? 2 * robot.limits.max_bending_rad * radius_m * sections / travel_m : 0;
}

std::vector<Eigen::Index> LonePositions(const Eigen::Ref<const Eigen::VectorXd>& position_rad,
                                        const RobotParameters& robot) {
  const double usual_rad = UsualWidth({position_rad.begin(), position_rad.end()});
  return LoneValues(position_rad, std::max(kLonePosition * usual_rad, kLoneWay * MostMotorWay_rad(robot)));
}

Masked MaskImplausible(DataSet& set) {
  Masked masked;
  std::vector<std::string>& said = masked.lines;
  const RobotParameters& robot = set.robot;
  Beyond tensions{"N"}, torques{"N m"}, targets{"N m"}, tips{"m"}, disks{"m"};
  for (Run& run : set.runs) {
    if (run.time_s.size() < 2) continue;
    Finder find{run, said, kSlack * robot.limits.min_tension_N};
    if (robot.actuation) {
      const auto tendons = static_cast<Eigen::Index>(robot.actuation->tendons.size());
      for (Eigen::Index j = 0; j < tendons; ++j) {
        const auto& drive = robot.actuation->tendons[static_cast<std::size_t>(j)].drive;
        const auto column = [&](Eigen::MatrixXd& matrix, const char* name, Beyond& kind, double most) {
          if (j < matrix.cols()) find.OutOfRange(matrix, j, fmt::format("{} {}", name, j + 1), most, kind);
        };
        column(run.tension_N, "tension", tensions, kBeyond * robot.limits.max_tension_motor_N);
        column(run.torque_actual_Nm, "actual torque", torques, kBeyond * drive.rated_torque_Nm);
        column(run.torque_target_Nm, "target torque", targets, kBeyond * drive.rated_torque_Nm);
      }
    }
    // In an unknown frame the tip may be anywhere.
    for (Eigen::Index axis = 0; axis < run.tip_m.cols() && !set.fit_frame; ++axis)
      find.OutOfRange(run.tip_m, axis, fmt::format("tip {}", "xyz"[axis]), kBeyond * robot.body.length_m(),
                      tips);
    for (Eigen::Index c = 0; c < run.disks_m.cols() && !set.fit_frame; ++c) {
      find.OutOfRange(run.disks_m, c, fmt::format("disk {} {}", c / 3 + 1, "xyz"[c % 3]),
                      kBeyond * robot.body.length_m(), disks);
    }
    MaskMarkerErrors(run, robot.body.length_m(), said);
    if (run.motor_position_rad.rows() != run.time_s.size()) continue;
    // Between states at rest a motor may have been anywhere.
    for (Eigen::Index j = 0; j < run.motor_position_rad.cols() && UsualStep(run) <= kQuasiStatic_s; ++j) {
      find.Unwrap(j);
      find.LoneMotorPositions(j, robot);
    }
    for (Eigen::Index j = 0; j < run.tension_N.cols(); ++j) {
      if (UsualStep(run) <= kQuasiStatic_s) find.LoneTensions(j, robot);
      find.FrozenCell(j);
      find.CutOff(run.tension_N, j, fmt::format("tension {}", j + 1), "N");
    }
    if (run.tip_m.cols() == 3) find.FrozenTip();
    for (Eigen::Index axis = 0; axis < run.tip_m.cols(); ++axis) {
      // A coarse table repeats values wherever nothing moves.
      if (DecimalStep(run.tip_m.col(axis)) < kCoarse * RangeOf(run.tip_m.col(axis)).width())
        find.CutOff(run.tip_m, axis, fmt::format("tip {}", "xyz"[axis]), "m");
    }
  }
  TakeOutTorquesCutOff(set, said);
  for (const auto& [name, kind] : {std::pair{"tension", tensions}, std::pair{"actual torque", torques},
                                   std::pair{"target torque", targets}, std::pair{"tip position", tips},
                                   std::pair{"position of the disks", disks}}) {
    if (kind.left_out > 0 && 2 * kind.left_out >= kind.columns) {
      masked.contradictions.push_back(
          fmt::format("the {} reaches {:.4g} {}, and this robot {:.3g} {} at most", name, kind.worst,
                      kind.unit, kind.most, kind.unit));
    }
  }
  return masked;
}

}  // namespace tendril::gap
