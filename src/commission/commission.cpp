// Pulls, averages, conclusions; see the header. One robot goes through all of them, and each reads what the
// others measured.
#include "tendril/commission/commission.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tendril/core/angle.h"
#include "tendril/core/drive_counts.h"
#include "tendril/model/capstan.h"

namespace tendril::commission {
namespace {

// Shares of controller.take_up.max_travel_m: travel of the first look for the tendon, and travel that loosens
// it.
constexpr double kFirstReach = 0.4, kLoosened = 0.1;
// The weaker of the two pulls between which a cell's gain is measured.
constexpr double kWeakPull = 0.6;
constexpr double kStanding_m = 2e-5, kStandingFor_s = 0.3;
// A shaft that moved less than this did not turn; gear and tendon compliance is smaller.
constexpr double kNotTurned_m = 2e-4;
// Share of the least tension of a pull that counts as an answer of the cell.
constexpr double kAnswer = 0.4;
// A change of tension that indicates a direction where no greater pull is allowed.
constexpr double kSign_N = 0.05;
// Uncertainty of gear losses and torque constant.
constexpr double kLeastGain = 0.7, kMostGain = 1.4;
// Share of the angle between neighbouring tendons within which a direction belongs to one.
constexpr double kNearShare = 0.35;
// A bend smaller than this has no direction.
constexpr double kLeastBend_m = 2e-4;

double Turn(double rad) { return std::remainder(rad, 2 * std::numbers::pi); }

struct Reading {
  TendonVector travel_m, cell_N,
      torque_N;  // travel since the start; torque over travel, without losses
  Eigen::Vector3d tip_m{0, 0, 0};
  int tips = 0;
};

class Procedure {
 public:
  Procedure(CommissionLink& link, const RobotParameters& robot, const DaemonParameters& daemon,
            const AskDirection& ask, const std::function<void(const std::string&)>& tell)
      : link_(link),
        robot_(robot),
        take_up_(daemon.controller.take_up),
        ask_(ask),
        tell_(tell),
        tables_(model::MakeCapstanTables(robot.actuation->tendons, robot.limits.max_tension_motor_N)),
        driven_(robot.actuation->DrivenTendons()) {
    const int m = robot.body.tendons();
    pull_N_ = TendonVector::Zero(m);
    result_.pull_N = take_up_.pull_N;
    for (const SectionParameters& s : robot.body.sections) {
      for (const TendonRoute& t : s.tendons) angles_rad_.push_back(t.angle_rad);
    }
    for (const int j : driven_) {
      const TendonDriveParameters& t = Drive(j);
      DriveFinding f;
      f.tendon = j + 1;
      for (const NodeParameters& n : daemon.bus.nodes) {
        if (n.tendon == j + 1) f.node = n;
      }
      f.has_cell = t.load_cell.place != LoadCellPlace::kNone;
      f.friction_N = t.motor.coulomb_friction_Nm / t.SpoolTravelPerMotorRad();
      result_.drives.push_back(f);
      if (ExpectedN(j, take_up_.pull_N) < 0.5 * robot.limits.min_tension_N) {
        throw std::runtime_error(
            fmt::format("controller.take_up.pull_N of {:g} N leaves {:.2g} N of tendon {}'s tension after "
                        "friction and gear; "
                        "accepted: {:.2g} N or more; raise it",
                        take_up_.pull_N, std::max(0., ExpectedN(j, take_up_.pull_N)), j + 1,
                        f.friction_N + robot.limits.min_tension_N / t.gear.efficiency));
      }
    }
  }

  CommissionResult Run() {
    Step();
    start_ = record_->input;
    counts_.assign(static_cast<std::size_t>(tendons()), 0);
    for (std::size_t j = 0; j < counts_.size(); ++j) last_counts_.push_back(start_.drive[j].position_counts);
    Release(0.3);
    for (const int j : driven_) FindSigns(j);
    for (const int j : driven_) Measure(j);
    for (const int j : driven_) Conclude(j);
    TakeUpAll();
    return result_;
  }

 private:
  int tendons() const { return robot_.body.tendons(); }
  const TendonDriveParameters& Drive(int j) const {
    return robot_.actuation->tendons[static_cast<std::size_t>(j)];
  }
  /// Of the drive that pulls tendon j, of a pair its first.
  DriveFinding& Finding(int j) {
    return result_.drives[static_cast<std::size_t>(robot_.actuation->DriveOf(j))];
  }

  // Least reading of the cell, on its side of the pulleys, for a pull that ended pulling.
  double ExpectedN(int j, double pull_N) const {
    const TendonDriveParameters& t = Drive(j);
    const double friction_N = t.motor.coulomb_friction_Nm / t.SpoolTravelPerMotorRad();
    return AtCell(j, (pull_N * t.motor.torque_scale - friction_N) * t.gear.efficiency);
  }
  double AtCell(int j, double motor_N) const {
    if (Drive(j).load_cell.place != LoadCellPlace::kRobotSide) return motor_N;
    return tables_[static_cast<std::size_t>(j)]->MotorToBase(std::max(0., motor_N), 1);
  }

  // ---- steps ----

  void Step() {
    record_ = &link_.Next();
    if (last_counts_.empty()) return;
    for (std::size_t j = 0; j < counts_.size(); ++j) {
      const std::int32_t now = record_->input.drive[j].position_counts;
      counts_[j] += CountsMoved(now, last_counts_[j]);
      last_counts_[j] = now;
    }
  }
  double Now() const { return ToSeconds(record_->input.time_ns); }
  double TravelM(int j) const {
    const TendonDriveParameters& t = Drive(j);
    const auto counts = static_cast<double>(counts_[static_cast<std::size_t>(j)]);
    return MotorAngle_rad(t.drive, counts) * t.SpoolTravelPerMotorRad();
  }

  void PullOnly(int j, double pull_N) {
    pull_N_.setZero();
    if (j >= 0) pull_N_[j] = pull_N;
    link_.Pull(pull_N_);
  }
  void Pass(double seconds) {
    for (const double end_s = Now() + seconds; Now() < end_s;) Step();
  }
  void Release(double seconds) {
    PullOnly(-1, 0);
    // A link may lag.
    while (record_->output.tension_desired_base_N.size() == tendons() &&
           record_->output.tension_desired_base_N.cwiseAbs().maxCoeff() > 1e-9) {
      Step();
    }
    Pass(seconds);
  }

  Reading Average(double seconds) {
    Reading sum{TendonVector::Zero(tendons()), TendonVector::Zero(tendons()), TendonVector::Zero(tendons()),
                Eigen::Vector3d::Zero(), 0};
    int count = 0;
    for (const double end_s = Now() + seconds; Now() < end_s || count == 0;) {
      Step();
      ++count;
      sum.cell_N += record_->output.tension_measured_N;
      for (int j = 0; j < tendons(); ++j) {
        sum.travel_m[j] += TravelM(j);
        sum.torque_N[j] += record_->output.torque_measured_Nm[j] / Drive(j).SpoolTravelPerMotorRad();
      }
      if (record_->input.tracker.valid) {
        sum.tip_m += record_->input.tracker.tip_W_m;
        ++sum.tips;
      }
    }
    sum.travel_m /= count;
    sum.cell_N /= count;
    sum.torque_N /= count;
    if (sum.tips > 0) sum.tip_m /= sum.tips;
    return sum;
  }

  enum class End { kStands, kRanOut, kSilent };

  // Pulls until the motor stands under the full pull, or has moved `reach_m`. Silent: an encoder not verified
  // yet gave no count at a pull that moves any free motor. The pull then goes no higher, because without an
  // encoder the speed is unbounded.
  End PullUntil(int j, double pull_N, double reach_m) {
    PullOnly(j, pull_N);
    const std::int64_t begin = counts_[static_cast<std::size_t>(j)];
    const double begin_m = TravelM(j), begin_s = Now();
    const double shown_N = std::max(loose_.cell_N[j], robot_.limits.min_tension_N);
    const double breakaway_N = 1.4 * Finding(j).friction_N + shown_N / Drive(j).gear.efficiency;
    const double least_s = 2 + 2 * reach_m / take_up_.max_speed_mps;
    double stood_m = begin_m, stood_since_s = begin_s;
    for (;;) {
      Step();
      const double at_m = TravelM(j);
      if (std::abs(at_m - begin_m) >= reach_m) return End::kRanOut;
      const double now_N = std::abs(record_->output.tension_desired_base_N[j]);
      const bool counted = std::abs(counts_[static_cast<std::size_t>(j)] - begin) > 1;
      if (Finding(j).encoder_sign == 0 && !counted && now_N > std::min(breakaway_N, 0.99 * std::abs(pull_N)))
        return End::kSilent;
      if (now_N < 0.99 * std::abs(pull_N) || std::abs(at_m - stood_m) > kStanding_m) {
        stood_m = at_m;
        stood_since_s = Now();
      }
      if (Now() - stood_since_s > kStandingFor_s || Now() - begin_s > 3 * least_s + 20) return End::kStands;
    }
  }

  // The cell that rose by this pull's tension: its own if it did, else the one that rose most. -1: none.
  int CellThatRose(int j, const Reading& before, const Reading& after) {
    TendonVector change_N = after.cell_N - before.cell_N;
    for (int k = 0; k < tendons(); ++k) {
      if (!Finding(k).has_cell) change_N[k] = 0;
    }
    const double answer_N = kAnswer * ExpectedN(j, take_up_.pull_N);
    if (Finding(j).has_cell && change_N[j] > answer_N) return j;
    Eigen::Index most = 0;
    return change_N.maxCoeff(&most) > answer_N ? static_cast<int>(most) : -1;
  }

  // ---- first look: which way the motor pulls and the encoder counts, leaving the tendon loose ----

  void FindSigns(int j) {
    DriveFinding& f = Finding(j);
    const auto at = static_cast<std::size_t>(j);
    tell_(fmt::format("tendon {} (node {}): which way does it pull", f.tendon, f.node.node_id));
    // Positive torque, negative torque, and positive again for a very loose tendon.
    constexpr std::array<std::pair<int, double>, 3> kTries{{{1, 1.0}, {-1, 2.0}, {1, 3.0}}};
    for (const auto& [sign, reaches] : kTries) {
      Release(0.2);
      loose_ = Average(0.2);
      const End end = PullUntil(j, sign * take_up_.pull_N, reaches * kFirstReach * take_up_.max_travel_m);
      const Reading pulled = Average(end == End::kSilent ? 0.02 : 0.2);
      if (end == End::kSilent) {
        const double rise_N = pulled.cell_N[j] - loose_.cell_N[j];
        if (f.has_cell && std::abs(rise_N) > kSign_N + 5 * Drive(j).load_cell.noise_N) {
          f.torque_sign = rise_N > 0 ? sign : -sign;
          f.cell_tendon = f.tendon;
          break;
        }
        continue;
      }
      const int cell = CellThatRose(j, loose_, pulled);
      if (cell >= 0) f.cell_tendon = cell + 1;
      turned_[at] = turned_[at] || std::abs(pulled.travel_m[j] - loose_.travel_m[j]) > kNotTurned_m;
      if (cell >= 0 || (end == End::kStands && turned_[at])) {
        f.torque_sign = sign;
        // The way back shows the encoder's sign for any slack.
        Release(0.1);
        const double before_m = TravelM(j);
        Loosen(j);
        const double back_m = TravelM(j) - before_m;
        if (std::abs(back_m) > kNotTurned_m) f.encoder_sign = back_m < 0 ? 1 : -1;
        f.slack_m = std::max(0., f.encoder_sign * pulled.travel_m[j]);
        break;
      }
    }
    Release(0.1);
  }

  void Loosen(int j) {
    PullOnly(j, -Finding(j).torque_sign * take_up_.pull_N);
    const double by_m = kLoosened * take_up_.max_travel_m, from_m = TravelM(j), begin_s = Now();
    const double patience_s = 2 + 2 * by_m / take_up_.max_speed_mps;
    while (std::abs(TravelM(j) - from_m) < by_m && Now() - begin_s < patience_s) Step();
    Release(0.2);
  }

  // ---- all others loose: zero and gain of the cell, slack, direction of the bend ----

  void Measure(int j) {
    DriveFinding& f = Finding(j);
    if (f.torque_sign == 0 || f.encoder_sign == 0) return;
    tell_(fmt::format("tendon {} (node {}): slack, load cell, direction", f.tendon, f.node.node_id));
    Release(0.2);
    loose_ = Average(0.4);
    const int cell = f.cell_tendon - 1;
    const double reach_m = kFirstReach * take_up_.max_travel_m;
    const double weak_N = f.torque_sign * kWeakPull * take_up_.pull_N;
    const double strong_N = f.torque_sign * take_up_.pull_N;
    if (PullUntil(j, weak_N, reach_m) != End::kStands) return;
    const Reading weak = Average(0.4);
    PullUntil(j, strong_N, reach_m);
    const Reading strong = Average(0.4);

    const TendonDriveParameters& t = Drive(j);
    const double torque_N = f.torque_sign * strong.torque_N[j] * t.motor.torque_scale;
    const double weak_torque_N = f.torque_sign * weak.torque_N[j] * t.motor.torque_scale;
    f.least_N = AtCell(j, std::max(0., torque_N - f.friction_N) * t.gear.efficiency);
    f.most_N = (torque_N + f.friction_N) / t.gear.efficiency;
    if (cell >= 0) {
      f.cell_zero_N = loose_.cell_N[cell];
      f.pulled_N = strong.cell_N[cell] - loose_.cell_N[cell];
      const double more_N = AtCell(j, (torque_N - f.friction_N) * t.gear.efficiency) -
                            AtCell(j, (weak_torque_N - f.friction_N) * t.gear.efficiency);
      if (more_N > 0.05) f.cell_gain = (strong.cell_N[cell] - weak.cell_N[cell]) / more_N;
    }
    if (strong.tips > 0 && loose_.tips > 0) {
      const Eigen::Vector3d bend_m = strong.tip_m - loose_.tip_m;
      if (bend_m.head<2>().norm() > kLeastBend_m) f.seen_angle_rad = std::atan2(bend_m.y(), bend_m.x());
    } else if (const auto seen = ask_(f.tendon, [this] { Step(); })) {
      f.seen_angle_rad = Turn(*seen);
    }
    TurnPair(f);
    Release(0.1);
    Loosen(j);
  }

  // A motor that pulls a pair stands either way, and only the bend shows which of the two it pulls.
  void TurnPair(DriveFinding& f) const {
    if (std::isnan(f.seen_angle_rad)) return;
    const int nearest = NearestTendon(f.seen_angle_rad);
    if (robot_.actuation->HasDrive(nearest)) return;
    f.torque_sign = -f.torque_sign;
    f.encoder_sign = -f.encoder_sign;
    f.seen_angle_rad = Turn(f.seen_angle_rad + std::numbers::pi);
  }
  int NearestTendon(double angle_rad) const {
    int nearest = 0;
    for (int k = 1; k < static_cast<int>(angles_rad_.size()); ++k) {
      if (Off(k, angle_rad) < Off(nearest, angle_rad)) nearest = k;
    }
    return nearest;
  }
  double Off(int tendon, double angle_rad) const {
    return std::abs(Turn(angle_rad - angles_rad_[static_cast<std::size_t>(tendon)]));
  }

  // ---- conclusions ----

  void Conclude(int j) {
    DriveFinding& f = Finding(j);
    const auto say = [&f](const std::string& verdict, const std::string& what, const std::string& remedy) {
      if (f.verdict.empty()) f.verdict = verdict;
      f.disagreements.push_back(
          {fmt::format("tendon {} (node {}): {}", f.tendon, f.node.node_id, what), remedy});
    };
    if (f.torque_sign == 0) {
      if (turned_[j]) {
        say("tendon off",
            fmt::format("the motor turns either way by more than {:.0f} mm of tendon and nothing holds it",
                        1e3 * kFirstReach * take_up_.max_travel_m),
            "attach the tendon; if it is that slack, wind it up by hand or raise "
            "controller.take_up.max_travel_m");
      } else {
        say("no answer",
            "neither encoder nor load cell responds to torque in either direction: jammed, or without "
            "current, or with a dead encoder",
            "free gear and spool; check the motor's leads and brake, and the encoder's cable; then turn the "
            "motor by "
            "hand and check that `tendril status` shows it");
      }
      return;
    }
    if (f.torque_sign < 0) {
      const bool both = f.encoder_sign < 0;
      say(both ? "spool reversed" : "motor reversed",
          both ? "positive torque pays out and the encoder counts with it: the tendon is wound in the "
                 "opposite direction"
               : "positive torque pays out",
          both ? fmt::format(
                     "wind it in the opposite direction, or give node {} motor: {}, encoder: {} in bus.nodes",
                     f.node.node_id, Other(f.node.motor_reversed), Other(f.node.encoder_reversed))
               : fmt::format("swap the motor's leads, or give node {} motor: {} in bus.nodes", f.node.node_id,
                             Other(f.node.motor_reversed)));
    } else if (f.encoder_sign < 0) {
      say("encoder reversed", "the encoder counts down while the motor pulls",
          fmt::format("swap its channels, or give node {} encoder: {} in bus.nodes", f.node.node_id,
                      Other(f.node.encoder_reversed)));
    }
    if (f.encoder_sign == 0) {
      say("encoder dead", "the tendon's tension responds to the motor, but the encoder does not count",
          "check the encoder's cable and supply, and the drive's sensor configuration");
      return;
    }
    ConcludeCell(f, say);
    ConcludeDirection(f, say);
    if (f.verdict.empty()) f.verdict = "ok";
  }

  // The value to write where it is wrong.
  static const char* Other(bool reversed) { return reversed ? "normal" : "reversed"; }

  template <class Say>
  void ConcludeCell(DriveFinding& f, const Say& say) {
    const int j = f.tendon - 1;
    if (f.cell_tendon == 0) {
      if (!f.has_cell) return;
      say("cell dead",
          fmt::format("the motor winds in until it stops, and no load cell shows it ({:.2f} N expected)",
                      ExpectedN(j, take_up_.pull_N)),
          "check the load cell's cable, supply and amplifier on the drive's first analog input");
      return;
    }
    if (f.cell_tendon != f.tendon) {
      say("cells crossed",
          fmt::format("its tension shows on the load cell of tendon {} (node {})", f.cell_tendon,
                      Finding(f.cell_tendon - 1).node.node_id),
          "plug each load cell into the drive of its own tendon");
      return;
    }
    const double zero_tolerance_N =
        std::max(0.25 * robot_.limits.min_tension_N, 3 * Drive(j).load_cell.noise_N);
    if (std::abs(f.cell_zero_N) > zero_tolerance_N) {
      say("cell zero",
          fmt::format("the load cell shows {:+.3f} N while the tendon is slack (up to {:.3f} N is accepted)",
                      f.cell_zero_N, zero_tolerance_N),
          fmt::format("tare it, or set actuation.load_cell.offset_N of tendon {} to {:.4g} in the robot file",
                      f.tendon, Drive(j).load_cell.offset_N + f.cell_zero_N));
    }
    if (std::isnan(f.cell_gain)) return;
    const double off_N = 0.1 + 0.25 * f.most_N;
    const bool beyond = f.pulled_N < f.least_N - off_N || f.pulled_N > f.most_N + off_N;
    if (f.cell_gain < kLeastGain || f.cell_gain > kMostGain || beyond) {
      say("cell gain",
          fmt::format("the load cell shows {:.2f} of the tension expected from the motor's torque ({:.2f} N "
                      "pulled; {:.2f} .. {:.2f} N with and against friction)",
                      f.cell_gain, f.pulled_N, f.least_N, f.most_N),
          fmt::format("hang a known mass on it and set load_cell.gain_VpN ({:.3g} would fit); or the motor's "
                      "torque_constant_NmpA, gear or spool are not as in the robot file",
                      Drive(j).load_cell.gain_VpN * f.cell_gain));
    }
  }

  template <class Say>
  void ConcludeDirection(DriveFinding& f, const Say& say) {
    if (std::isnan(f.seen_angle_rad)) {
      say("direction?",
          "the direction in which it bends the robot is unknown: the order of the drives is not verified",
          "run a tracker (tracker_t on PREFIX_TRACKER), answer at the prompt, or give --seen with the "
          "directions in "
          "degrees");
      return;
    }
    const int seen = NearestTendon(f.seen_angle_rad);
    const double nearest = Off(seen, f.seen_angle_rad);
    f.seen_tendon = seen + 1;
    double neighbours = 2 * std::numbers::pi;
    for (std::size_t k = 0; k < angles_rad_.size(); ++k) {
      for (std::size_t i = 0; i < k; ++i)
        neighbours = std::min(neighbours, std::abs(Turn(angles_rad_[k] - angles_rad_[i])));
    }
    if (nearest > kNearShare * neighbours) {
      f.seen_tendon = 0;
      say("direction?",
          fmt::format("the robot bends to {:.0f} deg, where no tendon is",
                      f.seen_angle_rad * kDegreesPerRadian),
          "check what the base frame's x axis is, and the holes' angle_rad in the robot file");
    } else if (f.seen_tendon != f.tendon) {
      say(fmt::format("pulls {}", f.seen_tendon),
          fmt::format("the robot bends to {:.0f} deg, where tendon {} is: node {} pulls that one",
                      f.seen_angle_rad * kDegreesPerRadian, f.seen_tendon, f.node.node_id),
          fmt::format("give node {} tendon: {} in bus.nodes of the daemon's file (or exchange the tendons)",
                      f.node.node_id, f.seen_tendon));
    }
  }

  // Takes all tendons up again gently, so that none is left loose.
  void TakeUpAll() {
    pull_N_.setZero();
    for (const DriveFinding& f : result_.drives) {
      const bool loose = robot_.actuation->PairOf(f.tendon - 1) == nullptr;
      if (loose && f.torque_sign != 0 && f.encoder_sign != 0) {
        pull_N_[f.tendon - 1] = f.torque_sign * (f.friction_N + kWeakPull * (take_up_.pull_N - f.friction_N));
      }
    }
    link_.Pull(pull_N_);
    Pass(2 + 2 * kLoosened * take_up_.max_travel_m / take_up_.max_speed_mps);
    Release(0.1);
  }

  CommissionLink& link_;
  const RobotParameters& robot_;
  const TakeUpParameters take_up_;
  const AskDirection& ask_;
  const std::function<void(const std::string&)>& tell_;
  const std::vector<std::shared_ptr<const model::CapstanTable>> tables_;
  const std::vector<int> driven_;  // tendons, by drive
  std::vector<double> angles_rad_;
  CommissionResult result_;
  const CycleRecord* record_ = nullptr;
  CycleInput start_;
  std::vector<std::int64_t> counts_;
  std::vector<std::int32_t> last_counts_;
  std::array<bool, kMaxTendons> turned_{};
  TendonVector pull_N_;
  Reading loose_;
};

}  // namespace

bool CommissionResult::passed() const {
  return !drives.empty() && std::all_of(drives.begin(), drives.end(),
                                        [](const DriveFinding& f) { return f.disagreements.empty(); });
}

CommissionResult Commission(CommissionLink& link, const RobotParameters& robot,
                            const DaemonParameters& daemon, const AskDirection& ask,
                            const std::function<void(const std::string&)>& tell) {
  return Procedure(link, robot, daemon, ask, tell).Run();
}

}  // namespace tendril::commission
