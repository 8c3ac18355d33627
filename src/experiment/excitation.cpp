// Programs of identification experiments from plan, robot and limits.
// Knows the controller's static model, nothing of buses, messages or files of data.
#include "tendril/experiment/excitation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <stdexcept>
#include <utility>

#include "tendril/control/compensation.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/held_directions.h"
#include "tendril/model/inverse.h"
#include "tendril/model/pull_cone.h"

namespace tendril::tools {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kPi = std::numbers::pi;
// Time between targets; a divisor of the trajectory's averaging windows, so that a staircase of targets
// becomes a smooth motion.
constexpr double kStep_s = 0.005;
constexpr double kRestAfter_s = 0.3;
// Shares of the robot's limits used by an experiment; the rest is for overshoot and for a robot that differs
// from its file.
constexpr double kBaseShare = 0.75, kMotorShare = 0.9, kCommandShare = 0.9, kBendingShare = 0.95;
constexpr double kRateShare = 0.8;
// Share of the largest tension below which quick motions keep no tendon, so that a motor that pays out does
// not overrun its tendon.
constexpr double kQuickLevel = 0.1, kQuickestLevel = 0.19;
// Corners of slow and quick motions are rounded over twice these times.
constexpr double kSlowCorner_s = 0.25, kQuickCorner_s = 0.06;
constexpr double kLongest_s = 600;

struct Family {
  std::string_view name;
  double amplitude_rad, duration_s, shortest_s;
};
constexpr Family kFamilies[] = {
    {"triangle", 1.8, 24, 4},  {"cocontraction", 0.9, 24, 6}, {"circle", 1.4, 14, 3}, {"steps", 1.6, 10, 4},
    {"multisine", 1.0, 13, 3}, {"ladder", 1.4, 14, 4},        {"hold", 1.4, 60, 4},   {"sway", 1.3, 6, 4},
};
constexpr auto kNames = [] {
  std::array<std::string_view, std::size(kFamilies)> names{};
  for (std::size_t i = 0; i < names.size(); ++i) names[i] = kFamilies[i].name;
  return names;
}();

const Family& FamilyOf(std::string_view name) {
  const auto* found = std::find_if(std::begin(kFamilies), std::end(kFamilies),
                                   [name](const Family& f) { return f.name == name; });
  if (found == std::end(kFamilies)) {
    throw std::invalid_argument(
        fmt::format("there is no experiment '{}'; accepted: {}", name, fmt::join(kNames, ", ")));
  }
  return *found;
}

/// Reference shapes on the grid of steps, with the minimum tension of any tendon during the motion.
struct Path {
  MatrixXd bending_rad;
  VectorXd level_N;
};

// ---- what the robot can hold ----

class Reach {
 public:
  Reach(const RobotParameters& robot, const ControllerParameters& controller)
      : robot_(robot),
        body_(robot.body),
        workspace_(body_),
        sections_(body_.sections()),
        tendons_(body_.tendons()),
        allocator_(tendons_, 2 * sections_),
        force_per_tension_(2 * sections_, tendons_),
        rest_(VectorXd::Zero(body_.dof())),
        q_(rest_),
        unit_force_(rest_) {
    for (int k = 0; k < sections_; ++k) cones_.push_back(model::PullConeOf(robot.body, k));
    std::vector<TransmissionParameters> transmissions;
    for (const auto& t : robot.actuation->tendons) transmissions.push_back(t.transmission);
    const auto tables = model::MakeCapstanTables(transmissions, robot.limits.max_tension_motor_N);
    for (int j = 0; j < tendons_; ++j) {
      tables_.push_back(std::make_shared<const model::CapstanTable>(tables[static_cast<std::size_t>(j)]));
      law_.emplace_back(robot.actuation->tendons[static_cast<std::size_t>(j)], robot.limits,
                        controller.capstan_compensation, tables_.back());
    }
  }

  int sections() const { return sections_; }
  int tendons() const { return tendons_; }
  double least_N() const { return robot_.limits.min_tension_N; }

  /// Bending of the whole robot by 1 rad in the plane at `beta_rad`: spread over the sections by length
  /// (pattern 0), or all in section `pattern`. Where a section's tendons do not pull in every direction, the
  /// part in their directions, with the plane counted from the first of these.
  VectorXd Direction(double beta_rad, int pattern = 0) const {
    VectorXd b = VectorXd::Zero(2 * sections_);
    for (int k = 0; k < sections_; ++k) {
      const model::PullCone& cone = cones_[static_cast<std::size_t>(k)];
      const double at_rad = beta_rad + cone.from_rad;
      const Eigen::Vector2d plane = cone.Nearest({std::cos(at_rad), std::sin(at_rad)});
      const auto& s = robot_.body.sections[static_cast<std::size_t>(k)];
      const double share = pattern == 0       ? s.units * s.unit_length_m / robot_.body.length_m()
                           : pattern == k + 1 ? 1.0
                                              : 0.0;
      b.segment<2>(2 * k) = share * plane;
    }
    return b;
  }
  /// Maps rows of bends in every direction into the directions that tendons pull: along a line, or about the
  /// middle of a wedge.
  void IntoPulled(MatrixXd& rows) const {
    for (int k = 0; k < sections_; ++k) {
      const model::PullCone& cone = cones_[static_cast<std::size_t>(k)];
      if (cone.kind == model::PullCone::Kind::kPlane) continue;
      auto own = rows.middleCols(2 * k, 2);
      if (cone.kind != model::PullCone::Kind::kLine) {
        const double middle_rad = cone.from_rad + 0.5 * cone.width_rad;
        const Eigen::RowVector2d middle(std::cos(middle_rad), std::sin(middle_rad));
        own = (0.5 * own).rowwise() + 0.5 * own.rowwise().norm().maxCoeff() * middle;
      }
      for (Eigen::Index i = 0; i < own.rows(); ++i)
        own.row(i) = cone.Nearest(own.row(i).transpose()).transpose();
    }
  }
  /// Whether tendons pull towards the bend, within a thousandth of an arc's length at its tip.
  bool Pulled(const VectorXd& bending_rad) const {
    for (int k = 0; k < sections_; ++k) {
      const Eigen::Vector2d bend = bending_rad.segment<2>(2 * k);
      if ((cones_[static_cast<std::size_t>(k)].Nearest(bend) - bend).norm() > 2e-3) return false;
    }
    return true;
  }
  /// Ways to spread a bend over the sections.
  int patterns() const { return sections_ == 1 ? 1 : sections_ + 1; }

  /// Base tensions that hold a bend at rest with none below `level_N`, or that come nearest where tendons do
  /// not pull in every direction; empty when there are none within the robot's limit.
  VectorXd Tensions(const VectorXd& bending_rad, double level_N) {
    body_.SpreadBending(bending_rad, q_);
    body_.InverseDynamics(q_, rest_, rest_, unit_force_, workspace_);
    const auto r = Allocate(bending_rad, level_N);
    if (r.bound != Status::kOk && r.bound != Status::kLimitedTensionMin) return {};
    return r.tension_N;
  }

  /// Whether a bend can be held, and reached, with a margin to every limit; `commanded`: by tension targets,
  /// which then include friction.
  bool Allowed(const VectorXd& bending_rad, double level_N, bool commanded) {
    for (int k = 0; k < sections_; ++k) {
      if (bending_rad.segment<2>(2 * k).norm() > kBendingShare * robot_.limits.max_bending_rad) return false;
    }
    const VectorXd tension = Tensions(bending_rad, level_N);
    if (tension.size() == 0 || tension.maxCoeff() > kBaseShare * robot_.limits.max_tension_base_N)
      return false;
    for (int j = 0; j < tendons_; ++j) {
      const double torque = PullTorque(j, tension[j]);
      if (table(j).Pull(tension[j]) > kMotorShare * robot_.limits.max_tension_motor_N) return false;
      if (torque > kMotorShare * law_[static_cast<std::size_t>(j)].max_torque_Nm()) return false;
      if (commanded && CommandFor(j, torque) > kCommandShare * robot_.limits.max_tension_base_N) return false;
    }
    return true;
  }

  /// Largest share of `bending_rad`, at most 1, that is allowed all the way from straight.
  double Share(const VectorXd& bending_rad, double level_N, bool commanded) {
    const auto allowed = [&](double share) { return Allowed(share * bending_rad, level_N, commanded); };
    constexpr double kCoarse = 0.125;
    double good = 0;
    while (good < 1 && allowed(std::min(1.0, good + kCoarse))) good = std::min(1.0, good + kCoarse);
    if (good >= 1) return 1;
    double bad = good + kCoarse;
    for (int i = 0; i < 8; ++i) {
      const double middle = 0.5 * (good + bad);
      (allowed(middle) ? good : bad) = middle;
    }
    return good;
  }
  /// The bend of `amplitude_rad` in a direction, reduced to the allowed share.
  VectorXd Bend(double amplitude_rad, double beta_rad, int pattern, double level_N, bool commanded) {
    VectorXd b = amplitude_rad * Direction(beta_rad, pattern);
    // A section alone is limited to the bend that the other sections' share would leave it.
    if (pattern > 0) b *= 0.7;
    return Share(b, level_N, commanded) * b;
  }
  /// Bend that is allowed in every plane.
  double EveryPlane(double amplitude_rad) {
    double least = 1;
    for (int i = 0; i < 24; ++i)
      least = std::min(least, Share(amplitude_rad * Direction(i * kPi / 12), least_N(), false));
    return least * amplitude_rad;
  }

  const model::CapstanTable& table(int j) const { return *tables_[static_cast<std::size_t>(j)]; }

  /// A tension command drives the motors as if nothing slid. These commands add what a motion needs: its
  /// inertia, the rotors', and friction along the planned sliding. One row per step.
  MatrixXd TensionCommands(const Path& path) {
    const Eigen::Index rows = path.bending_rad.rows();
    MatrixXd shortening(rows, tendons_), tension(rows, tendons_), command(rows, tendons_);
    const auto at = [&](Eigen::Index i) { return std::clamp<Eigen::Index>(i, 0, rows - 1); };
    const auto rate = [&](const MatrixXd& m, Eigen::Index i) -> VectorXd {
      return (m.row(at(i + 1)) - m.row(at(i - 1))).transpose() / (2 * kStep_s);
    };
    const auto acceleration = [&](const MatrixXd& m, Eigen::Index i) -> VectorXd {
      return (m.row(at(i + 1)) - 2 * m.row(i) + m.row(at(i - 1))).transpose() / (kStep_s * kStep_s);
    };
    VectorXd pulled(tendons_), dq(q_.size()), ddq(q_.size());
    for (Eigen::Index i = 0; i < rows; ++i) {
      body_.SpreadBending(path.bending_rad.row(i).transpose(), q_);
      body_.TendonShortening(q_, pulled);
      shortening.row(i) = pulled.transpose();
      body_.SpreadBending(rate(path.bending_rad, i), dq);
      body_.SpreadBending(acceleration(path.bending_rad, i), ddq);
      body_.InverseDynamics(q_, dq, ddq, unit_force_, workspace_);
      tension.row(i) = Allocate(path.bending_rad.row(i).transpose(), path.level_N[i]).tension_N.transpose();
    }
    for (int j = 0; j < tendons_; ++j) {
      auto& law = law_[static_cast<std::size_t>(j)];
      const auto& drive = robot_.actuation->tendons[static_cast<std::size_t>(j)];
      law.Reset(tension(0, j), shortening(0, j));
      for (Eigen::Index i = 0; i < rows; ++i) {
        const double rotor = drive.motor.rotor_inertia_kgm2 *
                             (shortening(at(i + 1), j) - 2 * shortening(i, j) + shortening(at(i - 1), j)) /
                             (kStep_s * kStep_s) / drive.SpoolTravelPerMotorRad();
        command(i, j) =
            std::min(CommandFor(j, law.Step(tension(i, j), shortening(i, j), true).torque_Nm + rotor),
                     kCommandShare * robot_.limits.max_tension_base_N);
      }
    }
    return command;
  }
  /// Tension command with this torque when nothing slides; at least the minimum tension.
  double CommandFor(int j, double torque_Nm) const {
    const auto& drive = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    const double motor_N = torque_Nm / drive.SpoolTravelPerMotorRad();
    double low = least_N(), high = 2 * robot_.limits.max_tension_motor_N;
    if (table(j).BaseToMotor(low, 0) >= motor_N) return low;
    for (int i = 0; i < 50; ++i) {
      const double middle = 0.5 * (low + high);
      (table(j).BaseToMotor(middle, 0) < motor_N ? low : high) = middle;
    }
    return high;
  }
  /// Torque that pulls against this tension at the base.
  double PullTorque(int j, double tension_N) const {
    const auto& drive = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    return table(j).Pull(tension_N) * drive.SpoolTravelPerMotorRad() / drive.gear.efficiency +
           drive.motor.coulomb_friction_Nm;
  }

 private:
  // Tensions for the force in unit_force_.
  model::TensionAllocator::Result Allocate(const VectorXd& bending_rad, double level_N) {
    VectorXd force(2 * sections_);
    body_.ProjectForce(unit_force_, force);
    model::SectionForcePerTension(body_, bending_rad, force_per_tension_);
    return allocator_.Allocate(force_per_tension_, force, level_N, robot_.limits.max_tension_base_N);
  }

  const RobotParameters& robot_;
  model::Body body_;
  model::Body::Workspace workspace_;
  int sections_, tendons_;
  model::TensionAllocator allocator_;
  MatrixXd force_per_tension_;
  VectorXd rest_, q_, unit_force_;
  std::vector<std::shared_ptr<const model::CapstanTable>> tables_;
  std::vector<control::Compensation> law_;
  std::vector<model::PullCone> cones_;
};

// ---- paths ----

/// Corners joined by straight lines, in time.
class Track {
 public:
  explicit Track(const VectorXd& start) : corners_{{0, start}} {}

  void Line(const VectorXd& to, double seconds) { corners_.push_back({end_s() + seconds, to}); }
  void Hold(double seconds) { Line(corners_.back().second, seconds); }
  double end_s() const { return corners_.back().first; }
  const VectorXd& end() const { return corners_.back().second; }

  MatrixXd Sample(int rows) const {
    MatrixXd m(rows, end().size());
    std::size_t next = 1;
    for (int i = 0; i < rows; ++i) {
      const double t = i * kStep_s;
      while (next + 1 < corners_.size() && corners_[next].first < t) ++next;
      const auto& [t0, a] = corners_[next - 1];
      const auto& [t1, b] = corners_[next];
      const double share = t1 > t0 ? std::clamp((t - t0) / (t1 - t0), 0.0, 1.0) : 1;
      m.row(i) = (a + share * (b - a)).transpose();
    }
    return m;
  }

 private:
  std::vector<std::pair<double, VectorXd>> corners_;
};

double SectionNorm(const VectorXd& bending) {
  double largest = 0;
  for (Eigen::Index k = 0; k + 1 < bending.size(); k += 2)
    largest = std::max(largest, bending.segment<2>(k).norm());
  return largest;
}

/// All corners in sequence at one speed of bending, in `seconds`; an entry beyond the bendings is a tension,
/// of which four newtons take as long as a radian.
void Follow(Track& track, const std::vector<VectorXd>& corners, double seconds) {
  const auto size = [](const VectorXd& change) {
    const Eigen::Index bendings = change.size() / 2 * 2;
    const double tension = bendings < change.size() ? std::abs(change[bendings]) / 4 : 0;
    return std::max(SectionNorm(change.head(bendings)), tension);
  };
  double length = 0;
  for (std::size_t i = 1; i < corners.size(); ++i) length += size(corners[i] - corners[i - 1]);
  for (std::size_t i = 1; i < corners.size(); ++i)
    track.Line(corners[i], seconds * size(corners[i] - corners[i - 1]) / length);
}

double Smooth(double share) { return 0.5 * (1 - std::cos(kPi * std::clamp(share, 0.0, 1.0))); }

struct Asked {
  double amplitude_rad, active_s, largest_N;
  std::uint64_t seed;
  const ControllerParameters& controller;
  int rows() const { return static_cast<int>(std::lround(active_s / kStep_s)) + 1; }
  double FastestBending() const { return kRateShare * controller.trajectory.max_rate_radps; }
};

MatrixXd MovingAverage(const MatrixXd& m, int rows) {
  MatrixXd mean(m.rows(), m.cols());
  const int half = rows / 2;
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(m.cols());
    for (int k = -half; k <= half; ++k) sum += m.row(std::clamp<Eigen::Index>(i + k, 0, m.rows() - 1));
    mean.row(i) = sum / (2 * half + 1);
  }
  return mean;
}

/// The track's corners rounded; it must rest for `corner_s` at both ends.
MatrixXd Rounded(const Track& track, int rows, double corner_s) {
  const int width = static_cast<int>(std::lround(corner_s / kStep_s));
  return MovingAverage(MovingAverage(track.Sample(rows), width), width);
}

VectorXd FadedLevel(const Asked& asked, double least_N, double level_N) {
  constexpr double kFade_s = 0.5;
  VectorXd level(asked.rows());
  for (int i = 0; i < level.size(); ++i) {
    const double t = i * kStep_s;
    level[i] = least_N + (level_N - least_N) * Smooth(t / kFade_s) * Smooth((asked.active_s - t) / kFade_s);
  }
  return level;
}

// ---- slow families: bending targets, from straight to straight ----

// Large and small loops in three planes off the tendons' own, with a minor loop in each.
MatrixXd Triangle(Reach& reach, const Asked& asked) {
  const VectorXd straight = VectorXd::Zero(2 * reach.sections());
  std::vector<VectorXd> corners{straight};
  constexpr double kPlanes[][2] = {{10, 1.0}, {70, 0.7}, {130, 0.45}};  // deg, share of the amplitude
  for (int p = 0; p < 3; ++p) {
    const double beta = kPlanes[p][0] * kPi / 180, bend = kPlanes[p][1] * asked.amplitude_rad;
    const int pattern = p % reach.patterns();
    const VectorXd there = reach.Bend(bend, beta, pattern, reach.least_N(), false);
    const VectorXd back = reach.Bend(bend, beta + kPi, pattern, reach.least_N(), false);
    corners.insert(corners.end(), {there, 0.5 * there, 0.8 * there, back, straight});
  }
  Track track(straight);
  track.Hold(kSlowCorner_s);
  Follow(track, corners, asked.active_s - 2 * kSlowCorner_s);
  track.Hold(kSlowCorner_s);
  return Rounded(track, asked.rows(), kSlowCorner_s);
}

// Share of a turn over a share of its time: constant speed except for its start and end.
constexpr double kTurnLead = 0.15;
double Turn(double share) {
  const double s = std::clamp(share, 0.0, 1.0), top = 1 / (1 - kTurnLead);
  const auto begin = [&](double t) {
    return 0.5 * top * (t - kTurnLead / kPi * std::sin(kPi * t / kTurnLead));
  };
  if (s < kTurnLead) return begin(s);
  if (s > 1 - kTurnLead) return 1 - begin(1 - s);
  return top * (s - kTurnLead / 2);
}

// One revolution at the full bend and, if there is time, one back at six tenths of it.
MatrixXd Circle(Reach& reach, const Asked& asked) {
  constexpr double kFrom = 0.3, kBackFrom_s = 9;
  // Turning, like any change of speed, must not make the motors overrun the tendons that they pay out.
  constexpr double kMostTurning_radps2 = 3;
  const bool back = asked.active_s >= kBackFrom_s;
  // Shares of the time: out, round, in to the smaller bend, round, home.
  const double out = back ? 0.1 : 0.13, round = back ? 0.42 : 0.74, in = back ? 0.06 : 0,
               round_back = back ? 0.32 : 0, home = 1 - out - round - in - round_back;
  const double turning = 2 * kPi / (1 - kTurnLead) / (round * asked.active_s);
  const double large =
      std::min(reach.EveryPlane(asked.amplitude_rad), kMostTurning_radps2 / (turning * turning));
  const double small = back ? 0.6 * large : large;
  MatrixXd m(asked.rows(), 2 * reach.sections());
  for (int i = 0; i < m.rows(); ++i) {
    const double s = i * kStep_s / asked.active_s;
    double bend = large * Smooth(s / out) - small * Smooth((s - (1 - home)) / home),
           turns = Turn((s - out) / round);
    if (back) {
      bend -= (large - small) * Smooth((s - out - round) / in);
      turns -= Turn((s - out - round - in) / round_back);
    }
    m.row(i) = (bend * reach.Direction(kFrom + 2 * kPi * turns)).transpose();
  }
  return m;
}

MatrixXd Hold(Reach& reach, const Asked& asked) {
  const VectorXd bend = reach.Bend(asked.amplitude_rad, 20 * kPi / 180, 0, reach.least_N(), false);
  const double move_s = std::min(2.0, 0.2 * asked.active_s);
  Track track(VectorXd::Zero(bend.size()));
  track.Hold(kSlowCorner_s);
  track.Line(bend, move_s);
  track.Hold(asked.active_s - 2 * move_s - 2 * kSlowCorner_s);
  track.Line(VectorXd::Zero(bend.size()), move_s);
  track.Hold(kSlowCorner_s);
  return Rounded(track, asked.rows(), kSlowCorner_s);
}

// ---- quick families, and those of several tensions: the path becomes tension targets ----

// Quick moves between held bends, spread over planes and amplitudes.
Path Steps(Reach& reach, const Asked& asked) {
  constexpr double kSpeed_radps = 3.0, kGoldenAngle = 2.399963229728653, kLead_s = 0.5;
  constexpr double kShares[] = {0.5, 1.0, 0.3, 0.8, 0.6, 0.9, 0.4};
  const double level = kQuickLevel * asked.largest_N;
  const int steps = std::clamp(static_cast<int>(asked.active_s / 1.25), 3, 14);
  std::vector<VectorXd> corners{VectorXd::Zero(2 * reach.sections())};
  for (int i = 0; i < steps; ++i) {
    corners.push_back(reach.Bend(kShares[i % 7] * asked.amplitude_rad, 0.2 + i * kGoldenAngle,
                                 i % reach.patterns(), level, true));
  }
  corners.push_back(corners.front());
  const double speed = std::min(kSpeed_radps, asked.FastestBending());
  double moving_s = 0;
  for (std::size_t i = 1; i < corners.size(); ++i)
    moving_s += SectionNorm(corners[i] - corners[i - 1]) / speed;
  const double hold_s = std::max(0.1, (asked.active_s - 2 * kLead_s - moving_s) / steps);
  Track track(corners.front());
  track.Hold(kLead_s);
  for (std::size_t i = 1; i < corners.size(); ++i) {
    track.Line(corners[i], SectionNorm(corners[i] - corners[i - 1]) / speed);
    if (i + 1 < corners.size()) track.Hold(hold_s);
  }
  return {Rounded(track, asked.rows(), kQuickCorner_s), FadedLevel(asked, reach.least_N(), level)};
}

// Sines from 0.1 to 10 Hz with random phases in both directions of every section.
Path Multisine(Reach& reach, const Asked& asked) {
  constexpr int kTones = 15;
  constexpr double kLowest_Hz = 0.1, kHighest_Hz = 10, kCorner_Hz = 1.5, kFade_s = 0.8;
  constexpr double kQuickest_radps2 = 80;
  std::mt19937_64 random(asked.seed);
  const auto uniform = [&random] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  const double level = kQuickestLevel * asked.largest_N;
  const int n = asked.rows(), columns = 2 * reach.sections();
  MatrixXd m = MatrixXd::Zero(n, columns);
  for (int c = 0; c < columns; ++c) {
    const double share = reach.Direction(0)[c / 2 * 2];
    for (int tone = 0; tone < kTones; ++tone) {
      const double f = kLowest_Hz * std::pow(kHighest_Hz / kLowest_Hz, tone / (kTones - 1.0));
      const double phase = 2 * kPi * uniform(), size = share / (1 + std::pow(f / kCorner_Hz, 1.5));
      for (int i = 0; i < n; ++i) m(i, c) += size * std::sin(2 * kPi * f * i * kStep_s + phase);
    }
  }
  reach.IntoPulled(m);
  // As large as amplitude, rate, acceleration and tensions allow.
  double bend = 0, rate = 0, acceleration = 0;
  for (int i = 0; i < n; ++i) {
    const double t = i * kStep_s;
    m.row(i) *= Smooth(t / kFade_s) * Smooth((asked.active_s - t) / kFade_s);
    Eigen::Vector2d whole(0, 0);
    for (int k = 0; k < reach.sections(); ++k) whole += m.row(i).segment<2>(2 * k).transpose();
    bend = std::max(bend, whole.norm());
    if (i > 0) rate = std::max(rate, SectionNorm((m.row(i) - m.row(i - 1)).transpose()) / kStep_s);
    if (i > 1) {
      const VectorXd change = (m.row(i) - 2 * m.row(i - 1) + m.row(i - 2)).transpose();
      acceleration = std::max(acceleration, SectionNorm(change) / (kStep_s * kStep_s));
    }
  }
  double scale =
      std::min({asked.amplitude_rad / bend, asked.FastestBending() / rate, kQuickest_radps2 / acceleration});
  for (int i = 0; i < n; i += 10) scale *= reach.Share(scale * m.row(i).transpose(), level, true);
  return {scale * m, FadedLevel(asked, reach.least_N(), level)};
}

// Oscillation about a bend that keeps the tendons loaded, from slow to fast.
Path Ladder(Reach& reach, const Asked& asked) {
  constexpr double kSlowest_radps = 0.1, kLead_s = 0.5;
  constexpr int kRungs = 6;
  const double fastest = std::min(3.0, asked.FastestBending()), level = kQuickLevel * asked.largest_N;
  const VectorXd top = reach.Bend(asked.amplitude_rad, 25 * kPi / 180, 0, level, true);
  const VectorXd middle = 0.5 * top, along = top / SectionNorm(top);
  const double approach_s = 0.1 * asked.active_s;
  double left_s = asked.active_s - 2 * approach_s - 2 * kLead_s;
  // Every rung takes the same time unless its speed crosses the whole range in less.
  std::vector<std::pair<double, double>> rungs;  // speed, half width
  for (int i = kRungs - 1; i >= 0; --i) {
    const double speed = kSlowest_radps * std::pow(fastest / kSlowest_radps, i / (kRungs - 1.0));
    const double width = std::min(0.48 * SectionNorm(top), speed * left_s / (i + 1) / 4);
    left_s -= 4 * width / speed;
    rungs.push_back({speed, width});
  }
  std::reverse(rungs.begin(), rungs.end());
  Track track(VectorXd::Zero(top.size()));
  track.Hold(kLead_s);
  track.Line(middle, approach_s);
  for (const auto& [speed, width] : rungs) {
    track.Line(middle + width * along, width / speed);
    track.Line(middle - width * along, 2 * width / speed);
    track.Line(middle, width / speed);
  }
  track.Line(VectorXd::Zero(top.size()), approach_s);
  track.Hold(kLead_s);
  return {Rounded(track, asked.rows(), kQuickCorner_s), FadedLevel(asked, reach.least_N(), level)};
}

// Three levels of co-contraction; at each slow reversals about straight and about a bend.
Path Cocontraction(Reach& reach, const Asked& asked) {
  constexpr double kLevels[] = {0.1, 0.2, 0.35};  // of the largest tension
  constexpr double kLead_s = 0.3;
  const int columns = 2 * reach.sections();
  const VectorXd straight = VectorXd::Zero(columns);
  // Corners: bending with the level as a further entry.
  std::vector<VectorXd> corners;
  const auto add = [&](const VectorXd& bend, double level) {
    corners.emplace_back(columns + 1);
    corners.back() << bend, level;
  };
  add(straight, reach.least_N());
  for (int i = 0; i < 3; ++i) {
    const double level = std::max(reach.least_N(), kLevels[i] * asked.largest_N);
    const VectorXd bend = reach.Bend(asked.amplitude_rad, (40 + 120 * i) * kPi / 180, 0, level, true);
    add(straight, level);
    for (const double share : {0.25, -0.25, 0.0, 1.0, 0.6, 1.0, 0.0}) add(share * bend, level);
  }
  add(straight, reach.least_N());
  Track track(corners.front());
  track.Hold(kLead_s);
  Follow(track, corners, asked.active_s - 2 * kLead_s);
  track.Hold(kLead_s);
  const MatrixXd m = Rounded(track, asked.rows(), kQuickCorner_s);
  return {m.leftCols(columns), m.col(columns)};
}

// Release from a bend to the minimum tension, twice; the robot sways freely.
MatrixXd Sway(Reach& reach, const Asked& asked) {
  constexpr double kLead_s = 0.15, kRelease_Nps = 25;
  const VectorXd straight = VectorXd::Zero(2 * reach.sections());
  Track track(straight);
  std::vector<double> let_go_s;
  for (const double beta_deg : {20.0, 140.0}) {
    const VectorXd bend = reach.Bend(asked.amplitude_rad, beta_deg * kPi / 180, 0, reach.least_N(), true);
    const double begin_s = track.end_s();
    track.Hold(kLead_s);
    track.Line(bend, 0.16 * asked.active_s);
    track.Hold(0.08 * asked.active_s);
    let_go_s.push_back(track.end_s());
    track.Line(straight, kStep_s);
    track.Hold(begin_s + 0.5 * asked.active_s - track.end_s());
  }
  const int rows = asked.rows();
  MatrixXd command = reach.TensionCommands(
      {Rounded(track, rows, kQuickCorner_s), VectorXd::Constant(rows, reach.least_N())});
  for (const double t : let_go_s) {
    const int from = static_cast<int>((t - kQuickCorner_s) / kStep_s);
    for (int i = from + 1; i < std::min(rows, static_cast<int>((t + 0.12 * asked.active_s) / kStep_s)); ++i) {
      command.row(i) = (command.row(i - 1).array() - kRelease_Nps * kStep_s).max(reach.least_N());
    }
  }
  return command;
}

// ---- own targets ----

MatrixXd Own(Reach& reach, const PlannedRun& run, const RobotParameters& robot,
             const ControllerParameters& controller) {
  const bool tension = run.targets == PlannedRun::Targets::kTension;
  const int columns = tension ? reach.tendons() : 2 * reach.sections();
  const char* key = tension ? "tension_N" : "bending_rad";
  const VectorXd start = tension ? VectorXd::Constant(columns, reach.least_N()) : VectorXd::Zero(columns);
  const double most_rate =
      kRateShare * (tension ? controller.pretension_ramp_Nps : controller.trajectory.max_rate_radps);
  Track track(start);
  const auto speed_over = [&](const VectorXd& change) {
    return tension ? change.cwiseAbs().maxCoeff() : SectionNorm(change);
  };
  for (const Waypoint& w : run.waypoints) {
    if (static_cast<int>(w.value.size()) != columns) {
      throw std::invalid_argument(
          fmt::format("{}: the target at t_s = {} has {} values of {}; this robot needs {}", run.family,
                      w.t_s, w.value.size(), key, columns));
    }
    const VectorXd to = Eigen::Map<const VectorXd>(w.value.data(), columns);
    if (!tension && !reach.Pulled(to)) {
      throw std::invalid_argument(fmt::format("{}: the bend at t_s = {} cannot be held: {}; change it",
                                              run.family, w.t_s, model::HeldDirections(robot.body)));
    }
    if (!tension && !reach.Allowed(to, reach.least_N(), false)) {
      throw std::invalid_argument(
          fmt::format("{}: the bend at t_s = {} needs more than {:.0f} % of the robot's bending or tension "
                      "limits; bend less",
                      run.family, w.t_s, 100 * kBaseShare));
    }
    if (tension && (to.minCoeff() < robot.limits.min_tension_N ||
                    to.maxCoeff() > kCommandShare * robot.limits.max_tension_base_N)) {
      throw std::invalid_argument(
          fmt::format("{}: the tensions at t_s = {} leave {} to {:.2f} N; change them", run.family, w.t_s,
                      robot.limits.min_tension_N, kCommandShare * robot.limits.max_tension_base_N));
    }
    const double seconds = w.t_s - track.end_s(), change = speed_over(to - track.end());
    if (!(seconds > 0) || change / seconds > most_rate) {
      throw std::invalid_argument(
          fmt::format("{}: reaching the target at t_s = {} in {:.3g} s would need {:.3g} {}; at most {:.3g}: "
                      "give it more time",
                      run.family, w.t_s, seconds,
                      seconds > 0 ? change / seconds : std::numeric_limits<double>::infinity(),
                      tension ? "N/s" : "rad/s", most_rate));
    }
    track.Line(to, seconds);
  }
  track.Line(start, std::max(0.5, speed_over(start - track.end()) / std::min(1.0, most_rate)));
  if (track.end_s() > kLongest_s) {
    throw std::invalid_argument(
        fmt::format("{}: targets later than {} s; split the run", run.family, kLongest_s));
  }
  return track.Sample(static_cast<int>(std::ceil(track.end_s() / kStep_s)) + 1);
}

/// Limits the rate to that of the controller for tension targets, so that the plan equals the targets sent.
MatrixXd RateLimited(MatrixXd command, const ControllerParameters& controller) {
  const double most = 0.95 * controller.pretension_ramp_Nps * kStep_s;
  for (Eigen::Index i = 1; i < command.rows(); ++i) {
    command.row(i) =
        command.row(i - 1) + (command.row(i) - command.row(i - 1)).cwiseMax(-most).cwiseMin(most);
  }
  return command;
}

struct Targets {
  MatrixXd rows;
  bool tension;
};

Targets FamilyTargets(Reach& reach, const PlannedRun& run, const RobotParameters& robot,
                      const ControllerParameters& controller) {
  const Family& family = FamilyOf(run.family);
  if (!(run.duration_s >= family.shortest_s && run.duration_s <= kLongest_s)) {
    throw std::invalid_argument(fmt::format("{}: duration_s is {}; accepted: {} to {} s", run.family,
                                            run.duration_s, family.shortest_s, kLongest_s));
  }
  const double most = robot.limits.max_bending_rad * reach.sections();
  if (!(run.amplitude_rad > 0 && run.amplitude_rad <= most)) {
    throw std::invalid_argument(fmt::format("{}: amplitude_rad is {}; accepted: above 0 to {} rad",
                                            run.family, run.amplitude_rad, most));
  }
  const Asked asked{.amplitude_rad = run.amplitude_rad,
                    .active_s = run.duration_s - kStillBefore_s - kRestAfter_s,
                    .largest_N = robot.limits.max_tension_base_N,
                    .seed = run.seed,
                    .controller = controller};
  if (run.family == "triangle") return {Triangle(reach, asked), false};
  if (run.family == "circle") return {Circle(reach, asked), false};
  if (run.family == "hold") return {Hold(reach, asked), false};
  const auto tension = [&](const Path& path) {
    return Targets{RateLimited(reach.TensionCommands(path), controller), true};
  };
  if (run.family == "cocontraction") return tension(Cocontraction(reach, asked));
  if (run.family == "steps") return tension(Steps(reach, asked));
  if (run.family == "multisine") return tension(Multisine(reach, asked));
  if (run.family == "ladder") return tension(Ladder(reach, asked));
  return {RateLimited(Sway(reach, asked), controller), true};
}

}  // namespace

std::span<const std::string_view> Families() { return kNames; }

PlannedRun UsualRun(std::string_view family) {
  const Family& f = FamilyOf(family);
  PlannedRun run;
  run.family = family;
  run.amplitude_rad = f.amplitude_rad;
  run.duration_s = f.duration_s;
  return run;
}

Program MakeProgram(const PlannedRun& run, const RobotParameters& robot,
                    const ControllerParameters& controller) {
  if (!robot.actuation) {
    throw std::invalid_argument(
        "robot '" + robot.name +
        "' has no actuation (motors, drives, tendons): use a rig file such as rig_90mm.yaml");
  }
  Reach reach(robot, controller);
  const auto [active, tension] =
      run.targets == PlannedRun::Targets::kFamily
          ? FamilyTargets(reach, run, robot, controller)
          : Targets{Own(reach, run, robot, controller), run.targets == PlannedRun::Targets::kTension};
  Program program;
  program.family = run.family;
  program.step_s = kStep_s;
  program.speed_radps = controller.trajectory.max_rate_radps;
  program.tension = tension;
  if (!program.tension) {
    double rate = 0;
    for (Eigen::Index i = 1; i < active.rows(); ++i) {
      rate = std::max(rate, SectionNorm((active.row(i) - active.row(i - 1)).transpose()) / kStep_s);
    }
    const double most = controller.trajectory.max_rate_radps;
    if (rate > most) {
      throw std::invalid_argument(
          fmt::format("{}: the bend would move at {:.2f} rad/s, the controller's limit is {}; "
                      "raise duration_s or lower amplitude_rad",
                      run.family, rate, most));
    }
  }
  const auto still = static_cast<Eigen::Index>(std::lround(kStillBefore_s / kStep_s));
  const auto rest = static_cast<Eigen::Index>(std::lround(kRestAfter_s / kStep_s));
  program.targets.resize(still + active.rows() - 1 + rest, active.cols());
  program.targets.topRows(still).rowwise() = active.row(0);
  program.targets.middleRows(still, active.rows() - 1) = active.topRows(active.rows() - 1);
  program.targets.bottomRows(rest).rowwise() = active.row(active.rows() - 1);
  if (tension) {
    // The tension added for the last motion's friction is removed.
    const double least_N = robot.limits.min_tension_N;
    for (Eigen::Index i = 0; i < rest; ++i) {
      const double left = 1 - Smooth(static_cast<double>(i + 1) / (0.7 * static_cast<double>(rest)));
      auto row = program.targets.row(program.targets.rows() - rest + i);
      row = (least_N + left * (row.array() - least_N)).matrix();
    }
    program.targets = RateLimited(program.targets, controller);
  }
  return program;
}

Command Program::At(double t_s) const {
  Command command;
  // Rounded: cycle times are sums of whole cycles, and rounding must not select the previous row.
  const auto row = std::min<Eigen::Index>(static_cast<Eigen::Index>(t_s / step_s + 1e-6), targets.rows() - 1);
  if (t_s < kStillBefore_s - 1e-9) return command;
  command.kind = tension ? CommandKind::kTension : CommandKind::kBending;
  if (tension) {
    command.tension_N = targets.row(row).transpose();
  } else {
    command.bending_rad = targets.row(row).transpose();
    command.speed_radps = speed_radps;
  }
  return command;
}

}  // namespace tendril::tools
