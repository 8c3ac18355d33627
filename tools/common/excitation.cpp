// Programs of identification experiments from plan, robot and limits.
// Knows the controller's static model, nothing of buses, messages or files of data.
#include "excitation.h"

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
#include "tendril/model/inverse.h"

namespace tendril::tools {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kPi = std::numbers::pi;
// Between targets; a whole divisor of the trajectory's averaging windows, so that a stair of targets becomes
// an even motion.
constexpr double kStep_s = 0.005;
constexpr double kRestAfter_s = 0.3;
// Of the robot's limits, what an experiment asks for: the rest is for overshoot and for a robot that differs
// from its file.
constexpr double kBaseShare = 0.75, kMotorShare = 0.9, kCommandShare = 0.95, kBendingShare = 0.95;
constexpr double kRateShare = 0.8;
constexpr double kLongest_s = 600;

struct Family {
  std::string_view name;
  double amplitude_rad, duration_s, shortest_s;
};
constexpr Family kFamilies[] = {
    {"triangle", 1.5, 24, 4},  {"cocontraction", 0.9, 24, 6}, {"circle", 1.1, 14, 3}, {"steps", 1.4, 10, 4},
    {"multisine", 1.0, 13, 3}, {"ladder", 1.2, 14, 4},        {"hold", 1.2, 60, 4},   {"sway", 1.2, 6, 4},
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
        fmt::format("no experiment is called '{}'; there are {}", name, fmt::join(kNames, ", ")));
  }
  return *found;
}

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

  /// Bending that turns the whole robot by 1 rad in the plane at `beta_rad`: spread over the sections by
  /// length (pattern 0), or all in section `pattern`.
  VectorXd Direction(double beta_rad, int pattern = 0) const {
    VectorXd b = VectorXd::Zero(2 * sections_);
    const Eigen::Vector2d plane(std::cos(beta_rad), std::sin(beta_rad));
    for (int k = 0; k < sections_; ++k) {
      const auto& s = robot_.body.sections[static_cast<std::size_t>(k)];
      const double share = pattern == 0       ? s.units * s.unit_length_m / robot_.body.length_m()
                           : pattern == k + 1 ? 1.0
                                              : 0.0;
      b.segment<2>(2 * k) = share * plane;
    }
    return b;
  }
  /// Ways to spread a bend over the sections.
  int patterns() const { return sections_ == 1 ? 1 : sections_ + 1; }

  /// Tensions at the base that hold a bend at rest with none below `level_N`; empty when there are none
  /// within the robot's limit.
  VectorXd Tensions(const VectorXd& bending_rad, double level_N) {
    body_.SpreadBending(bending_rad, q_);
    body_.InverseDynamics(q_, rest_, rest_, unit_force_, workspace_);
    VectorXd force(2 * sections_);
    body_.ProjectForce(unit_force_, force);
    model::SectionForcePerTension(body_, bending_rad, force_per_tension_);
    const auto r = allocator_.Allocate(force_per_tension_, force, level_N, robot_.limits.max_tension_base_N);
    if (r.status != Status::kOk) return {};
    return r.tension_N;
  }

  bool Allowed(const VectorXd& bending_rad, double level_N) {
    for (int k = 0; k < sections_; ++k) {
      if (bending_rad.segment<2>(2 * k).norm() > kBendingShare * robot_.limits.max_bending_rad) return false;
    }
    const VectorXd tension = Tensions(bending_rad, level_N);
    if (tension.size() == 0 || tension.maxCoeff() > kBaseShare * robot_.limits.max_tension_base_N)
      return false;
    for (int j = 0; j < tendons_; ++j) {
      if (table(j).Pull(tension[j]) > kMotorShare * robot_.limits.max_tension_motor_N) return false;
      if (PullTorque(j, tension[j]) > kMotorShare * law_[static_cast<std::size_t>(j)].max_torque_Nm())
        return false;
    }
    return true;
  }

  /// Largest share of `bending_rad`, at most 1, that is allowed all the way from straight.
  double Share(const VectorXd& bending_rad, double level_N,
               const std::function<bool(const VectorXd&)>& also = {}) {
    const auto allowed = [&](double share) {
      const VectorXd b = share * bending_rad;
      return Allowed(b, level_N) && (!also || also(b));
    };
    double good = 0;
    constexpr double kCoarse = 0.05;
    while (good < 1 && allowed(std::min(1.0, good + kCoarse))) good = std::min(1.0, good + kCoarse);
    if (good >= 1) return 1;
    double bad = good + kCoarse;
    for (int i = 0; i < 8; ++i) {
      const double middle = 0.5 * (good + bad);
      (allowed(middle) ? good : bad) = middle;
    }
    return good;
  }
  /// The bend of `amplitude_rad` in a direction, or what is allowed of it.
  VectorXd Bend(double amplitude_rad, double beta_rad, int pattern = 0) {
    VectorXd b = amplitude_rad * Direction(beta_rad, pattern);
    // A section alone is not asked for more than the others' share would leave it.
    if (pattern > 0) b *= 0.7;
    return Share(b, least_N()) * b;
  }
  /// Bend that every plane allows.
  double EveryPlane(double amplitude_rad) {
    double least = 1;
    for (int i = 0; i < 24; ++i)
      least = std::min(least, Share(amplitude_rad * Direction(i * kPi / 12), least_N()));
    return least * amplitude_rad;
  }

  const model::CapstanTable& table(int j) const { return *tables_[static_cast<std::size_t>(j)]; }

  /// A tension command drives the motors as if nothing slid. These are the commands that make them drive as
  /// the tensions along a path of bends need: friction follows the planned motion. Rows: points of the path.
  MatrixXd TensionCommands(const MatrixXd& bending_rad, const VectorXd& level_N) {
    MatrixXd command(bending_rad.rows(), tendons_);
    VectorXd shortening(tendons_);
    for (Eigen::Index i = 0; i < bending_rad.rows(); ++i) {
      const VectorXd b = bending_rad.row(i).transpose();
      const VectorXd tension = Tensions(b, level_N[i]);
      if (tension.size() == 0) throw std::invalid_argument("a bend beyond the robot's largest tensions");
      body_.SpreadBending(b, q_);
      body_.TendonShortening(q_, shortening);
      for (int j = 0; j < tendons_; ++j) {
        auto& law = law_[static_cast<std::size_t>(j)];
        if (i == 0) law.Reset(tension[j], shortening[j]);
        command(i, j) = CommandFor(j, law.Step(tension[j], shortening[j], true).torque_Nm);
      }
    }
    return command;
  }
  /// Tension command whose torque, with nothing sliding, is this one; at least the least tension.
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
  const RobotParameters& robot_;
  model::Body body_;
  model::Body::Workspace workspace_;
  int sections_, tendons_;
  model::TensionAllocator allocator_;
  MatrixXd force_per_tension_;
  VectorXd rest_, q_, unit_force_;
  std::vector<std::shared_ptr<const model::CapstanTable>> tables_;
  std::vector<control::Compensation> law_;
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

/// All corners one after the other at one speed, in `seconds`.
Track AtOneSpeed(const std::vector<VectorXd>& corners, double seconds) {
  double length = 0;
  for (std::size_t i = 1; i < corners.size(); ++i) length += SectionNorm(corners[i] - corners[i - 1]);
  Track track(corners.front());
  for (std::size_t i = 1; i < corners.size(); ++i) {
    track.Line(corners[i], seconds * SectionNorm(corners[i] - corners[i - 1]) / length);
  }
  return track;
}

double Smooth(double share) { return 0.5 * (1 - std::cos(kPi * std::clamp(share, 0.0, 1.0))); }

struct Asked {
  double amplitude_rad, active_s;
  std::uint64_t seed;
  const ControllerParameters& controller;
  int rows() const { return static_cast<int>(std::lround(active_s / kStep_s)) + 1; }
};

// ---- the families; each returns targets over `active_s`, from straight to straight ----

// Large and small loops in three planes off the tendons' own, with a minor loop in each.
MatrixXd Triangle(Reach& reach, const Asked& asked) {
  const VectorXd straight = VectorXd::Zero(2 * reach.sections());
  std::vector<VectorXd> corners{straight};
  constexpr double kPlanes[][2] = {{10, 1.0}, {70, 0.7}, {130, 0.45}};  // deg, share of the amplitude
  for (int p = 0; p < 3; ++p) {
    const double beta = kPlanes[p][0] * kPi / 180;
    const int pattern = p % reach.patterns();
    const VectorXd there = reach.Bend(kPlanes[p][1] * asked.amplitude_rad, beta, pattern);
    const VectorXd back = reach.Bend(kPlanes[p][1] * asked.amplitude_rad, beta + kPi, pattern);
    corners.insert(corners.end(), {there, 0.5 * there, 0.8 * there, back, straight});
  }
  return AtOneSpeed(corners, asked.active_s).Sample(asked.rows());
}

// One way round at the full bend, the other way round at six tenths of it.
MatrixXd Circle(Reach& reach, const Asked& asked) {
  const double large = reach.EveryPlane(asked.amplitude_rad), small = 0.6 * large;
  constexpr double kFrom = 0.3;
  // Shares of the time: out, round, in to the smaller bend, round, home.
  const double out = 0.1, round = 0.42, in = 0.06, round_back = 0.32;
  MatrixXd m(asked.rows(), 2 * reach.sections());
  for (int i = 0; i < m.rows(); ++i) {
    const double s = i * kStep_s / asked.active_s;
    const double bend =
        large * Smooth(s / out) - (large - small) * Smooth((s - out - round) / in) -
        small * Smooth((s - out - round - in - round_back) / (1 - out - round - in - round_back));
    const double angle =
        kFrom + 2 * kPi * (Smooth((s - out) / round) - Smooth((s - out - round - in) / round_back));
    m.row(i) = (bend * reach.Direction(angle)).transpose();
  }
  return m;
}

// Quick moves between bends spread over planes and amplitudes, each held.
MatrixXd Steps(Reach& reach, const Asked& asked) {
  constexpr double kSpeed_radps = 3.0, kGoldenAngle = 2.399963229728653;
  constexpr double kShares[] = {0.5, 1.0, 0.3, 0.8, 0.6, 0.9, 0.4};
  std::vector<VectorXd> corners{VectorXd::Zero(2 * reach.sections())};
  const int steps = std::clamp(static_cast<int>(asked.active_s / 1.25), 3, 14);
  for (int i = 0; i < steps; ++i) {
    corners.push_back(
        reach.Bend(kShares[i % 7] * asked.amplitude_rad, 0.2 + i * kGoldenAngle, i % reach.patterns()));
  }
  corners.push_back(corners.front());
  const double speed = std::min(kSpeed_radps, kRateShare * asked.controller.trajectory.max_rate_radps);
  double moving_s = 0;
  for (std::size_t i = 1; i < corners.size(); ++i)
    moving_s += SectionNorm(corners[i] - corners[i - 1]) / speed;
  const double hold_s = (asked.active_s - moving_s) / steps;
  Track track(corners.front());
  for (std::size_t i = 1; i < corners.size(); ++i) {
    track.Line(corners[i], SectionNorm(corners[i] - corners[i - 1]) / speed);
    if (i + 1 < corners.size()) track.Hold(std::max(0.0, hold_s));
  }
  return track.Sample(asked.rows());
}

// Share of a sinusoid that the trajectory's two averages pass.
double TrajectoryGain(const TrajectoryParameters& t, double frequency_Hz) {
  const auto sinc = [](double x) { return std::abs(x) < 1e-9 ? 1.0 : std::sin(kPi * x) / (kPi * x); };
  return std::abs(sinc(frequency_Hz * 2 * t.max_rate_radps / t.max_acceleration_radps2) *
                  sinc(frequency_Hz * 2 * t.max_acceleration_radps2 / t.max_jerk_radps3));
}

// Sines from 0.1 to 10 Hz with drawn phases in both directions of every section; what the trajectory takes
// from the quick ones is given to them beforehand.
MatrixXd Multisine(Reach& reach, const Asked& asked) {
  constexpr int kTones = 15;
  constexpr double kLowest_Hz = 0.1, kHighest_Hz = 10, kCorner_Hz = 2, kFade_s = 0.6, kMostEmphasis = 4;
  std::mt19937_64 random(asked.seed);
  const auto uniform = [&random] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  const auto& limits = asked.controller.trajectory;
  const int n = asked.rows(), columns = 2 * reach.sections();
  const MatrixXd spread = [&] {
    MatrixXd s(columns, 1);
    for (int k = 0; k < reach.sections(); ++k) s(2 * k) = s(2 * k + 1) = reach.Direction(0)[2 * k];
    return s;
  }();
  MatrixXd m = MatrixXd::Zero(n, columns);
  for (int c = 0; c < columns; ++c) {
    for (int tone = 0; tone < kTones; ++tone) {
      const double f = kLowest_Hz * std::pow(kHighest_Hz / kLowest_Hz, tone / (kTones - 1.0));
      const double phase = 2 * kPi * uniform();
      const double size = spread(c) / (1 + std::pow(f / kCorner_Hz, 1.5)) /
                          std::max(1 / kMostEmphasis, TrajectoryGain(limits, f));
      for (int i = 0; i < n; ++i) m(i, c) += size * std::sin(2 * kPi * f * i * kStep_s + phase);
    }
  }
  for (int i = 0; i < n; ++i) {
    const double t = i * kStep_s;
    m.row(i) *= Smooth(t / kFade_s) * Smooth((asked.active_s - t) / kFade_s);
  }
  // As large as amplitude, rate, acceleration and tensions allow.
  double bend = 0, rate = 0, acceleration = 0;
  for (int i = 0; i < n; ++i) {
    VectorXd whole = VectorXd::Zero(2);
    for (int k = 0; k < reach.sections(); ++k) whole += m.row(i).segment<2>(2 * k).transpose();
    bend = std::max(bend, whole.norm());
    if (i > 0) rate = std::max(rate, SectionNorm((m.row(i) - m.row(i - 1)).transpose()) / kStep_s);
    if (i > 1) {
      acceleration =
          std::max(acceleration, SectionNorm((m.row(i) - 2 * m.row(i - 1) + m.row(i - 2)).transpose()) /
                                     (kStep_s * kStep_s));
    }
  }
  double scale = std::min({asked.amplitude_rad / bend, kRateShare * limits.max_rate_radps / rate,
                           kRateShare * limits.max_acceleration_radps2 / acceleration});
  for (int i = 0; i < n; i += 4) scale *= reach.Share(scale * m.row(i).transpose(), reach.least_N());
  return scale * m;
}

// To and fro about a bend that keeps the tendons loaded, from slow to fast.
MatrixXd Ladder(Reach& reach, const Asked& asked) {
  constexpr double kSlowest_radps = 0.1;
  constexpr int kRungs = 6;
  const double fastest = std::min(3.0, kRateShare * asked.controller.trajectory.max_rate_radps);
  const double beta = 25 * kPi / 180;
  const VectorXd top = reach.Bend(asked.amplitude_rad, beta);
  const double most = SectionNorm(top);
  const VectorXd middle = 0.5 * top, along = top / most;
  // Every rung gets the same time unless its speed crosses the whole range in less.
  const double approach_s = 0.12 * asked.active_s;
  double left_s = asked.active_s - 2 * approach_s;
  std::vector<std::pair<double, double>> rungs;  // speed, half width
  for (int i = kRungs - 1; i >= 0; --i) {
    const double speed = kSlowest_radps * std::pow(fastest / kSlowest_radps, i / (kRungs - 1.0));
    const double width = std::min(0.48 * most, speed * left_s / (i + 1) / 4);
    left_s -= 4 * width / speed;
    rungs.push_back({speed, width});
  }
  std::reverse(rungs.begin(), rungs.end());
  Track track(VectorXd::Zero(top.size()));
  track.Line(middle, approach_s);
  for (const auto& [speed, width] : rungs) {
    track.Line(middle + width * along, width / speed);
    track.Line(middle - width * along, 2 * width / speed);
    track.Line(middle, width / speed);
  }
  track.Line(VectorXd::Zero(top.size()), approach_s);
  return track.Sample(asked.rows());
}

MatrixXd Hold(Reach& reach, const Asked& asked) {
  const VectorXd bend = reach.Bend(asked.amplitude_rad, 20 * kPi / 180);
  const double move_s = std::min(1.5, 0.2 * asked.active_s);
  Track track(VectorXd::Zero(bend.size()));
  track.Line(bend, move_s);
  track.Hold(asked.active_s - 2 * move_s);
  track.Line(VectorXd::Zero(bend.size()), move_s);
  return track.Sample(asked.rows());
}

// Let go from a bend to the least tension, twice; the robot sways freely.
MatrixXd Sway(Reach& reach, const Asked& asked) {
  const double release = std::min(6.0, kRateShare * asked.controller.trajectory.max_rate_radps);
  const VectorXd straight = VectorXd::Zero(2 * reach.sections());
  Track track(straight);
  for (const double beta_deg : {20.0, 140.0}) {
    const VectorXd bend = reach.Bend(asked.amplitude_rad, beta_deg * kPi / 180);
    const double begin_s = track.end_s();
    track.Line(bend, 0.12 * asked.active_s);
    track.Hold(0.08 * asked.active_s);
    track.Line(straight, SectionNorm(bend) / release);
    track.Hold(begin_s + 0.5 * asked.active_s - track.end_s());
  }
  return track.Sample(asked.rows());
}

// Three levels of co-contraction; at each slow reversals about straight and about a bend.
MatrixXd Cocontraction(Reach& reach, const RobotParameters& robot, const Asked& asked) {
  constexpr double kLevels[] = {0.1, 0.2, 0.35};  // of the largest tension
  constexpr double kBendSpeed_radps = 0.5, kLevelSpeed_Nps = 2.0;
  const int columns = 2 * reach.sections();
  // Corners: bending with the level as a further entry.
  std::vector<VectorXd> corners;
  const auto add = [&](const VectorXd& bend, double level) {
    VectorXd corner(columns + 1);
    corner << bend, level;
    corners.push_back(corner);
  };
  const VectorXd straight = VectorXd::Zero(columns);
  add(straight, reach.least_N());
  for (int i = 0; i < 3; ++i) {
    const double level = std::max(reach.least_N(), kLevels[i] * robot.limits.max_tension_base_N);
    const double beta = (40 + 120 * i) * kPi / 180;
    const VectorXd wanted = asked.amplitude_rad * reach.Direction(beta);
    const auto commandable = [&](const VectorXd& b) {
      const VectorXd tension = reach.Tensions(b, level);
      for (int j = 0; j < reach.tendons(); ++j) {
        if (reach.CommandFor(j, reach.PullTorque(j, tension[j])) >
            kCommandShare * robot.limits.max_tension_base_N) {
          return false;
        }
      }
      return true;
    };
    const VectorXd bend = reach.Share(wanted, level, commandable) * wanted;
    add(straight, level);
    add(0.25 * bend, level);
    add(-0.25 * bend, level);
    add(straight, level);
    add(bend, level);
    add(0.6 * bend, level);
    add(bend, level);
    add(straight, level);
  }
  add(straight, reach.least_N());

  // Fine points along the path; then each gets the time that its speeds and the controller's rate of tension
  // targets need.
  std::vector<VectorXd> points{corners.front()};
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const VectorXd from = corners[i - 1], change = corners[i] - from;
    const double seconds = std::max(SectionNorm(change.head(columns)) / kBendSpeed_radps,
                                    std::abs(change[columns]) / kLevelSpeed_Nps);
    const int pieces = std::max(1, static_cast<int>(std::ceil(seconds / kStep_s)));
    for (int p = 1; p <= pieces; ++p) points.push_back(from + change * p / pieces);
  }
  MatrixXd bending(static_cast<Eigen::Index>(points.size()), columns);
  VectorXd level(bending.rows());
  for (Eigen::Index i = 0; i < bending.rows(); ++i) {
    bending.row(i) = points[static_cast<std::size_t>(i)].head(columns).transpose();
    level[i] = points[static_cast<std::size_t>(i)][columns];
  }
  const MatrixXd command = reach.TensionCommands(bending, level);
  const double rate = 0.9 * asked.controller.pretension_ramp_Nps;
  const auto times = [&](double pace_s) {
    VectorXd t = VectorXd::Zero(command.rows());
    for (Eigen::Index i = 1; i < t.size(); ++i) {
      t[i] = t[i - 1] + std::max(pace_s, (command.row(i) - command.row(i - 1)).cwiseAbs().maxCoeff() / rate);
    }
    return t;
  };
  if (const double least_s = times(0).tail(1)[0]; least_s > asked.active_s) {
    throw std::invalid_argument(fmt::format(
        "cocontraction needs duration_s of at least {:.0f} s with this controller, whose tension targets "
        "move at {} N/s (controller.pretension_ramp_Nps)",
        std::ceil(least_s + kStillBefore_s + kRestAfter_s + 0.5), asked.controller.pretension_ramp_Nps));
  }
  double low = 0, high = asked.active_s;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (times(middle).tail(1)[0] < asked.active_s ? low : high) = middle;
  }
  const VectorXd t = times(low);
  Track track(command.row(0).transpose());
  for (Eigen::Index i = 1; i < t.size(); ++i) track.Line(command.row(i).transpose(), t[i] - t[i - 1]);
  return track.Sample(asked.rows());
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
    if (!tension && !reach.Allowed(to, reach.least_N())) {
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
        fmt::format("{}: targets beyond {} s; split the run", run.family, kLongest_s));
  }
  return track.Sample(static_cast<int>(std::ceil(track.end_s() / kStep_s)) + 1);
}

MatrixXd FamilyTargets(Reach& reach, const PlannedRun& run, const RobotParameters& robot,
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
                    .seed = run.seed,
                    .controller = controller};
  if (run.family == "triangle") return Triangle(reach, asked);
  if (run.family == "cocontraction") return Cocontraction(reach, robot, asked);
  if (run.family == "circle") return Circle(reach, asked);
  if (run.family == "steps") return Steps(reach, asked);
  if (run.family == "multisine") return Multisine(reach, asked);
  if (run.family == "ladder") return Ladder(reach, asked);
  if (run.family == "hold") return Hold(reach, asked);
  return Sway(reach, asked);
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
  const bool own = run.targets != PlannedRun::Targets::kFamily;
  const MatrixXd active =
      own ? Own(reach, run, robot, controller) : FamilyTargets(reach, run, robot, controller);
  Program program;
  program.family = run.family;
  program.step_s = kStep_s;
  program.speed_radps = controller.trajectory.max_rate_radps;
  program.tension = own ? run.targets == PlannedRun::Targets::kTension : run.family == "cocontraction";
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
  return program;
}

Command Program::At(double t_s) const {
  Command command;
  // Half a step on: cycle times are sums of whole cycles, and rounding must not pick the row before.
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
