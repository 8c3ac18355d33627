// Positions that stand still, tested by the residual between tension and stretch.
#include "frozen_motors.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "comparable.h"
#include "health_signal.h"
#include "implausible.h"
#include "squares.h"

namespace tendril::gap {
namespace {

constexpr double kHeld = 0.15;   // of the largest tension: smaller changes are ignored
constexpr double kFarAbove = 8;  // times the residual between stretch and tension elsewhere

/// Intervals of one motor at one value.
void AddStanding(const DataSet& set, std::size_t at, Eigen::Index tendon,
                 std::vector<FrozenMotor>& standing) {
  const Run& run = set.runs[at];
  const auto x = run.motor_position_rad.col(tendon);
  const double next_s = kBridged_s + UsualStep(run);  // in a longer gap the motor may have moved and returned
  FrozenMotor now{at, tendon, 0, 0};
  const auto end = [&] {
    if (now.to == 0 || run.time_s[now.to - 1] - run.time_s[now.from] < kFrozen_s) return;
    const auto tension_N = run.tension_N.col(tendon).segment(now.from, now.to - now.from);
    now.tension_N = UsualWidth({tension_N.begin(), tension_N.end()});
    standing.push_back(now);
  };
  for (Eigen::Index row = 0; row < x.size(); ++row) {
    if (!std::isfinite(x[row])) continue;
    const bool goes_on =
        now.to > 0 && x[row] == x[now.from] && run.time_s[row] - run.time_s[now.to - 1] < next_s;
    if (!goes_on) {
      end();
      now.from = row;
    }
    now.to = row + 1;
  }
  end();
}

/// The change of tension that friction in motor and gear can hold.
double Held_N(const DataSet& set, const FrozenMotor& f) {
  const Run& run = set.runs[f.run];
  const auto tension_N = run.tension_N.col(f.tendon).segment(f.from, f.to - f.from);
  double held_N = kHeld * set.robot.limits.max_tension_motor_N;
  if (!set.robot.actuation) return held_N;
  const TendonDriveParameters& drive = set.robot.actuation->tendons[static_cast<std::size_t>(f.tendon)];
  const double travel_m = drive.SpoolTravelPerMotorRad(), efficiency = drive.gear.efficiency;
  if (!(travel_m > 0) || !(efficiency > 0)) return held_N;
  const double most_N = Largest(tension_N);
  return std::max(held_N,
                  2 * drive.motor.coulomb_friction_Nm / travel_m + (1 / efficiency - efficiency) * most_N);
}

bool Throughout(const DataSet& set, const FrozenMotor& f) {
  const std::vector<Eigen::Index> rows = FiniteRows(set.runs[f.run].motor_position_rad.col(f.tendon));
  return f.from == rows.front() && f.to == rows.back() + 1;
}

}  // namespace

std::vector<FrozenMotor> FindFrozenMotors(const DataSet& set, const Evaluator& evaluator) {
  if (!evaluator.has(kC3)) return {};
  std::vector<FrozenMotor> standing;
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    const Run& run = set.runs[i];
    for (Eigen::Index j = 0; j < std::min(run.motor_position_rad.cols(), run.tension_N.cols()); ++j)
      AddStanding(set, i, j, standing);
  }
  const auto loaded = [&](const FrozenMotor& f) { return f.tension_N >= Held_N(set, f); };
  if (std::none_of(standing.begin(), standing.end(), loaded)) return {};
  if (Compared(set)) {
    std::erase_if(standing, [&](const FrozenMotor& f) { return !loaded(f) || !Throughout(set, f); });
    return standing;
  }

  // The residual between stretch and tension in each such interval, and elsewhere.
  std::map<std::pair<std::size_t, Eigen::Index>, std::vector<std::size_t>> of_motor;  // by run and tendon
  for (std::size_t k = 0; k < standing.size(); ++k)
    of_motor[{standing[k].run, standing[k].tendon}].push_back(k);
  std::vector<Squares> still(standing.size());
  std::map<Eigen::Index, Squares> moving;
  std::map<Eigen::Index, double> floor;
  Squares usual;
  for (std::size_t c = 0; c < evaluator.channels().size(); ++c) {
    const Channel& channel = evaluator.channels()[c];
    if (channel.cut != sim::Cut::kTendon) continue;
    floor[channel.index] = channel.white;
    for (std::size_t i = 0; i < set.runs.size(); ++i) {
      const Eigen::VectorXd& time_s = set.runs[i].time_s;
      const PreparedRun& run = evaluator.runs()[i];
      const double window_s = evaluator.window_s(static_cast<int>(i), static_cast<int>(c));
      const std::vector<std::size_t>& its = of_motor[{i, channel.index}];
      const auto& variance = evaluator.Variance()[i][c];
      for (Eigen::Index w = 0; w < variance.size(); ++w) {
        if (!std::isfinite(variance[w])) continue;
        // For states at rest a window is a row.
        const double at_s = run.signals.at_rest ? run.start_s + run.signals.time_s[w]
                                                : run.start_s + (static_cast<double>(w) + 0.5) * window_s;
        const double about_s = run.signals.at_rest ? 1e-9 : window_s;
        const auto in = std::find_if(its.begin(), its.end(), [&](std::size_t k) {
          return at_s > time_s[standing[k].from] - about_s && at_s < time_s[standing[k].to - 1] + about_s;
        });
        const double left_N = evaluator.AtNominal()[i][c][w];
        if (in != its.end()) {
          still[*in].Add(left_N);
        } else {
          moving[channel.index].Add(left_N);
          usual.Add(left_N);
        }
      }
    }
  }
  const auto wrong = [&](std::size_t k) {
    const Eigen::Index tendon = standing[k].tendon;
    return still[k].rms() > kFarAbove * std::max({usual.rms(), moving[tendon].rms(), floor[tendon]});
  };
  std::set<Eigen::Index> known;  // tendons with at least one clearly frozen interval
  for (std::size_t k = 0; k < standing.size(); ++k) {
    if (loaded(standing[k]) && wrong(k)) known.insert(standing[k].tendon);
  }
  std::vector<FrozenMotor> frozen;
  for (std::size_t k = 0; k < standing.size(); ++k) {
    if (known.contains(standing[k].tendon) && wrong(k)) frozen.push_back(standing[k]);
  }
  return frozen;
}

}  // namespace tendril::gap
