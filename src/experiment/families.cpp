#include "families.h"

#include <algorithm>
#include <numbers>
#include <random>
#include <vector>

#include "track.h"

namespace tendril::experiment {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kPi = std::numbers::pi;
// Share of the largest tension below which quick motions keep no tendon, so that a motor that pays out does
// not overrun its tendon.
constexpr double kQuickLevel = 0.1, kQuickestLevel = 0.19;
// Corners of slow and quick motions are rounded over twice these times.
constexpr double kSlowCorner_s = 0.25, kQuickCorner_s = 0.06;

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
MatrixXd Triangle(Allowance& robot, const Asked& asked) {
  const VectorXd straight = VectorXd::Zero(2 * robot.sections());
  std::vector<VectorXd> corners{straight};
  constexpr double kPlanes[][2] = {{10, 1.0}, {70, 0.7}, {130, 0.45}};  // deg, share of the amplitude
  for (int p = 0; p < 3; ++p) {
    const double beta = kPlanes[p][0] * kPi / 180, bend = kPlanes[p][1] * asked.amplitude_rad;
    const int pattern = p % robot.patterns();
    const VectorXd there = robot.Bend(bend, beta, pattern, robot.least_N(), false);
    const VectorXd back = robot.Bend(bend, beta + kPi, pattern, robot.least_N(), false);
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
MatrixXd Circle(Allowance& robot, const Asked& asked) {
  constexpr double kFrom = 0.3, kBackFrom_s = 9;
  // Turning, like any change of speed, must not make the motors overrun the tendons that they pay out.
  constexpr double kMostTurning_radps2 = 3;
  const bool back = asked.active_s >= kBackFrom_s;
  // Shares of the time: out, round, in to the smaller bend, round, home.
  const double out = back ? 0.1 : 0.13, round = back ? 0.42 : 0.74, in = back ? 0.06 : 0,
               round_back = back ? 0.32 : 0, home = 1 - out - round - in - round_back;
  const double turning = 2 * kPi / (1 - kTurnLead) / (round * asked.active_s);
  const double large =
      std::min(robot.EveryPlane(asked.amplitude_rad), kMostTurning_radps2 / (turning * turning));
  const double small = back ? 0.6 * large : large;
  MatrixXd m(asked.rows(), 2 * robot.sections());
  for (int i = 0; i < m.rows(); ++i) {
    const double s = i * kStep_s / asked.active_s;
    double bend = large * Smooth(s / out) - small * Smooth((s - (1 - home)) / home),
           turns = Turn((s - out) / round);
    if (back) {
      bend -= (large - small) * Smooth((s - out - round) / in);
      turns -= Turn((s - out - round - in) / round_back);
    }
    m.row(i) = (bend * robot.Direction(kFrom + 2 * kPi * turns)).transpose();
  }
  return m;
}

MatrixXd Hold(Allowance& robot, const Asked& asked) {
  const VectorXd bend = robot.Bend(asked.amplitude_rad, 20 * kPi / 180, 0, robot.least_N(), false);
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
Path Steps(Allowance& robot, const Asked& asked) {
  constexpr double kSpeed_radps = 3.0, kGoldenAngle = 2.399963229728653, kLead_s = 0.5;
  constexpr double kShares[] = {0.5, 1.0, 0.3, 0.8, 0.6, 0.9, 0.4};
  const double level = kQuickLevel * asked.largest_N;
  const int steps = std::clamp(static_cast<int>(asked.active_s / 1.25), 3, 14);
  std::vector<VectorXd> corners{VectorXd::Zero(2 * robot.sections())};
  for (int i = 0; i < steps; ++i) {
    corners.push_back(robot.Bend(kShares[i % 7] * asked.amplitude_rad, 0.2 + i * kGoldenAngle,
                                 i % robot.patterns(), level, true));
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
  return {Rounded(track, asked.rows(), kQuickCorner_s), FadedLevel(asked, robot.least_N(), level)};
}

// Sines from 0.1 to 10 Hz with random phases in both directions of every section.
Path Multisine(Allowance& robot, const Asked& asked) {
  constexpr int kTones = 15;
  constexpr double kLowest_Hz = 0.1, kHighest_Hz = 10, kCorner_Hz = 1.5, kFade_s = 0.8;
  constexpr double kQuickest_radps2 = 80;
  std::mt19937_64 random(asked.seed);
  const auto uniform = [&random] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  const double level = kQuickestLevel * asked.largest_N;
  const int n = asked.rows(), columns = 2 * robot.sections();
  MatrixXd m = MatrixXd::Zero(n, columns);
  for (int c = 0; c < columns; ++c) {
    const double share = robot.Direction(0)[c / 2 * 2];
    for (int tone = 0; tone < kTones; ++tone) {
      const double f = kLowest_Hz * std::pow(kHighest_Hz / kLowest_Hz, tone / (kTones - 1.0));
      const double phase = 2 * kPi * uniform(), size = share / (1 + std::pow(f / kCorner_Hz, 1.5));
      for (int i = 0; i < n; ++i) m(i, c) += size * std::sin(2 * kPi * f * i * kStep_s + phase);
    }
  }
  robot.IntoPulled(m);
  // As large as amplitude, rate, acceleration and tensions allow.
  double bend = 0, rate = 0, acceleration = 0;
  for (int i = 0; i < n; ++i) {
    const double t = i * kStep_s;
    m.row(i) *= Smooth(t / kFade_s) * Smooth((asked.active_s - t) / kFade_s);
    Eigen::Vector2d whole(0, 0);
    for (int k = 0; k < robot.sections(); ++k) whole += m.row(i).segment<2>(2 * k).transpose();
    bend = std::max(bend, whole.norm());
    if (i > 0) rate = std::max(rate, SectionNorm((m.row(i) - m.row(i - 1)).transpose()) / kStep_s);
    if (i > 1) {
      const VectorXd change = (m.row(i) - 2 * m.row(i - 1) + m.row(i - 2)).transpose();
      acceleration = std::max(acceleration, SectionNorm(change) / (kStep_s * kStep_s));
    }
  }
  double scale =
      std::min({asked.amplitude_rad / bend, asked.FastestBending() / rate, kQuickest_radps2 / acceleration});
  for (int i = 0; i < n; i += 10) scale *= robot.Share(scale * m.row(i).transpose(), level, true);
  return {scale * m, FadedLevel(asked, robot.least_N(), level)};
}

// Oscillation about a bend that keeps the tendons loaded, from slow to fast.
Path Ladder(Allowance& robot, const Asked& asked) {
  constexpr double kSlowest_radps = 0.1, kLead_s = 0.5;
  constexpr int kRungs = 6;
  const double fastest = std::min(3.0, asked.FastestBending()), level = kQuickLevel * asked.largest_N;
  const VectorXd top = robot.Bend(asked.amplitude_rad, 25 * kPi / 180, 0, level, true);
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
  return {Rounded(track, asked.rows(), kQuickCorner_s), FadedLevel(asked, robot.least_N(), level)};
}

// Three levels of co-contraction; at each slow reversals about straight and about a bend.
Path Cocontraction(Allowance& robot, const Asked& asked) {
  constexpr double kLevels[] = {0.1, 0.2, 0.35};  // of the largest tension
  constexpr double kLead_s = 0.3;
  const int columns = 2 * robot.sections();
  const VectorXd straight = VectorXd::Zero(columns);
  // Corners: bending with the level as a further entry.
  std::vector<VectorXd> corners;
  const auto add = [&](const VectorXd& bend, double level) {
    corners.emplace_back(columns + 1);
    corners.back() << bend, level;
  };
  add(straight, robot.least_N());
  for (int i = 0; i < 3; ++i) {
    const double level = std::max(robot.least_N(), kLevels[i] * asked.largest_N);
    const VectorXd bend = robot.Bend(asked.amplitude_rad, (40 + 120 * i) * kPi / 180, 0, level, true);
    add(straight, level);
    for (const double share : {0.25, -0.25, 0.0, 1.0, 0.6, 1.0, 0.0}) add(share * bend, level);
  }
  add(straight, robot.least_N());
  Track track(corners.front());
  track.Hold(kLead_s);
  Follow(track, corners, asked.active_s - 2 * kLead_s);
  track.Hold(kLead_s);
  const MatrixXd m = Rounded(track, asked.rows(), kQuickCorner_s);
  return {m.leftCols(columns), m.col(columns)};
}

// Release from a bend to the minimum tension, twice; the robot sways freely.
MatrixXd Sway(Allowance& robot, const Asked& asked) {
  constexpr double kLead_s = 0.15, kRelease_Nps = 25;
  const VectorXd straight = VectorXd::Zero(2 * robot.sections());
  Track track(straight);
  std::vector<double> let_go_s;
  for (const double beta_deg : {20.0, 140.0}) {
    const VectorXd bend = robot.Bend(asked.amplitude_rad, beta_deg * kPi / 180, 0, robot.least_N(), true);
    const double begin_s = track.end_s();
    track.Hold(kLead_s);
    track.Line(bend, 0.16 * asked.active_s);
    track.Hold(0.08 * asked.active_s);
    let_go_s.push_back(track.end_s());
    track.Line(straight, kStep_s);
    track.Hold(begin_s + 0.5 * asked.active_s - track.end_s());
  }
  const int rows = asked.rows();
  MatrixXd command = robot.TensionCommands(
      {Rounded(track, rows, kQuickCorner_s), VectorXd::Constant(rows, robot.least_N())});
  for (const double t : let_go_s) {
    const int from = static_cast<int>((t - kQuickCorner_s) / kStep_s);
    for (int i = from + 1; i < std::min(rows, static_cast<int>((t + 0.12 * asked.active_s) / kStep_s)); ++i) {
      command.row(i) = (command.row(i - 1).array() - kRelease_Nps * kStep_s).max(robot.least_N());
    }
  }
  return command;
}

}  // namespace

MatrixXd RateLimited(MatrixXd command, const ControllerParameters& controller) {
  const double most = 0.95 * controller.pretension_ramp_Nps * kStep_s;
  for (Eigen::Index i = 1; i < command.rows(); ++i) {
    command.row(i) =
        command.row(i - 1) + (command.row(i) - command.row(i - 1)).cwiseMax(-most).cwiseMin(most);
  }
  return command;
}

Targets FamilyTargets(std::string_view family, Allowance& robot, const Asked& asked) {
  if (family == "triangle") return {Triangle(robot, asked), false};
  if (family == "circle") return {Circle(robot, asked), false};
  if (family == "hold") return {Hold(robot, asked), false};
  const auto tension = [&](const Path& path) {
    return Targets{RateLimited(robot.TensionCommands(path), asked.controller), true};
  };
  if (family == "cocontraction") return tension(Cocontraction(robot, asked));
  if (family == "steps") return tension(Steps(robot, asked));
  if (family == "multisine") return tension(Multisine(robot, asked));
  if (family == "ladder") return tension(Ladder(robot, asked));
  return {RateLimited(Sway(robot, asked), asked.controller), true};
}

}  // namespace tendril::experiment
