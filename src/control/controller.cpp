#include "tendril/control/controller.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "state_archive.h"
#include "tendon_side.h"
#include "tendril/control/compensation.h"
#include "tendril/control/drive_feed_forward.h"
#include "tendril/control/equilibrium_law.h"
#include "tendril/control/estimator.h"
#include "tendril/control/gate.h"
#include "tendril/control/guards.h"
#include "tendril/control/reach.h"
#include "tendril/control/shape_feedback.h"
#include "tendril/control/supervisor.h"
#include "tendril/control/take_up.h"
#include "tendril/control/tension_feedback.h"
#include "tendril/control/tension_ramp.h"
#include "tendril/control/tip_feedback.h"
#include "tendril/control/trajectory.h"
#include "tendril/model/inverse.h"

namespace tendril::control {
namespace {

using ForceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, kMaxTendons>;

// A tendon this close to pretension counts as released.
constexpr double kReleasedTension_N = 1e-6;
// In commissioning, drives are disabled after this time without a pull command.
constexpr TimeNs kUnusedFor_ns = 2 * kNsPerS;
// Drives need some hundredths of a second to switch on. The master gives up after 2 s with a more specific
// status.
constexpr TimeNs kEnableWithin_ns = 3 * kNsPerS;
// Time allowed for a tendon to show its minimum tension once that should have settled.
constexpr TimeNs kTautWithin_ns = 2 * kNsPerS;
// A slower reference counts as at rest: a micrometre of tendon in ten seconds.
constexpr double kRest_mps = 1e-7, kRest_Nps = 1e-3;
constexpr double kHeldPermille = 0.8;
// Share of the motor's friction, which alone holds a spool without tension, that the torque may pay out
// against; below one, because the robot file may overstate it.
constexpr double kPaidOut = 0.5;
constexpr double kCellDoubt_N = 0.5;
// A spool faster than this while its cell shows no tension has lost its tendon.
constexpr double kLost_mps = 0.01;
// Time constant of shape feedback relative to that of the tension loops below it; share of the motors' dry
// friction that it leaves alone at rest.
constexpr double kShapeFeedback = 10, kShapeRest = 0.1;
// Decay of the extra minimum tension after fast motion: the next fast motion may follow soon, and the robot
// still oscillates.
constexpr double kRotorFades_Nps = 3;
constexpr double kDisagrees_s = 0.5;  // disagreement of tracker and tendons before it is reported
constexpr double kNearBound = 0.125;  // share of a tension's bound within which the approach slows down
constexpr double kStopRamp_s = 0.9;   // ramp-down time of tensions when the daemon stops

const RobotParameters& Checked(const RobotParameters& robot) {
  if (!robot.actuation) {
    throw std::invalid_argument(
        "robot '" + robot.name +
        "' has no actuation: a controller needs motors, gears and tendons; use a rig file");
  }
  if (static_cast<int>(robot.actuation->tendons.size()) != robot.body.tendons()) {
    throw std::invalid_argument("robot '" + robot.name + "': one drive per tendon is needed");
  }
  if (robot.body.tendons() > kMaxTendons || robot.body.units() > kMaxUnits ||
      static_cast<int>(robot.body.sections.size()) > kMaxSections) {
    throw std::invalid_argument("robot '" + robot.name + "' exceeds the controller's capacity of " +
                                std::to_string(kMaxSections) + " sections, " + std::to_string(kMaxUnits) +
                                " units, " + std::to_string(kMaxTendons) + " tendons");
  }
  return robot;
}

LimitParameters CommandedLimits(LimitParameters limits) {
  limits.max_tension_base_N =
      std::max(kCommandedTensionShare * limits.max_tension_base_N, limits.min_tension_N);
  return limits;
}

bool SameTransmission(const TransmissionParameters& a, const TransmissionParameters& b) {
  if (a.low_tension_N != b.low_tension_N || a.pulleys.size() != b.pulleys.size()) return false;
  for (std::size_t i = 0; i < a.pulleys.size(); ++i) {
    const PulleyParameters &p = a.pulleys[i], &q = b.pulleys[i];
    if (p.law != q.law || p.wrap_rad != q.wrap_rad || p.radius_ratio != q.radius_ratio ||
        p.alpha != q.alpha || p.exponent != q.exponent || p.entry_angle_rad != q.entry_angle_rad) {
      return false;
    }
  }
  return true;
}

// One table per tendon; tendons over equal pulleys share one.
std::vector<std::shared_ptr<const model::CapstanTable>> MakeTables(const RobotParameters& robot) {
  std::vector<std::shared_ptr<const model::CapstanTable>> tables;
  const auto& drives = robot.actuation->tendons;
  for (std::size_t j = 0; j < drives.size(); ++j) {
    for (std::size_t i = 0; i < j && tables.size() == j; ++i) {
      if (SameTransmission(drives[i].transmission, drives[j].transmission)) tables.push_back(tables[i]);
    }
    if (tables.size() == j) {
      tables.push_back(std::make_shared<const model::CapstanTable>(drives[j].transmission,
                                                                   robot.limits.max_tension_motor_N));
    }
  }
  return tables;
}

}  // namespace

struct Controller::Impl {
  // The nearest tip that the robot's arcs reach and its tensions hold.
  struct NearestTip {
    BendingVector bending_rad;
    Eigen::Vector3d tip_W_m;
    double distance_m;
    Status reached, held;
  };

  Impl(const RobotParameters& robot_in, const ControllerParameters& parameters_in, TimeNs period_ns)
      : robot(Checked(robot_in)),
        parameters(parameters_in),
        period_s(ToSeconds(period_ns)),
        sections(static_cast<int>(robot.body.sections.size())),
        tendons(robot.body.tendons()),
        reach_tolerance_m(1e-3 * robot.body.length_m()),
        body(robot.body),
        workspace(body),
        tables(MakeTables(robot)),
        gate(robot, parameters.trajectory.default_speed_radps, parameters.take_up.pull_N),
        take_up(robot, parameters.take_up, parameters.pretension_ramp_Nps, parameters.pretension_settle_s,
                period_ns),
        kinematics(body, robot.limits.max_bending_rad),
        trajectory(sections, parameters.trajectory, robot.limits.max_bending_rad, period_ns),
        reach(robot, body, CommandedLimits(robot.limits), trajectory.gather_s(),
              parameters.law == ControlLaw::kEquilibrium),
        tension_ramp(body, reach.CommandedTensionRate_radps(), trajectory.gather_s(), period_s),
        allocator(tendons, 2 * sections),
        estimator(robot, body, tables, period_s),
        guards(robot, parameters.guards, period_ns, body, tables),
        equilibrium(body, CommandedLimits(robot.limits)),
        uses_equilibrium(parameters.law == ControlLaw::kEquilibrium),
        force_per_tension(2 * sections, tendons),
        tension_N(TendonVector::Zero(tendons)),
        goal_rad(BendingVector::Zero(2 * sections)),
        goal_rate_radps(BendingVector::Zero(2 * sections)),
        q(UnitVector::Zero(body.dof())),
        dq(q),
        ddq(q),
        unit_force_Nm(q),
        last_reference_N(tension_N),
        last_reference_m(tension_N),
        shown_m(tension_N) {
    if (period_ns <= 0) throw std::invalid_argument("the control period must be positive");
    if (!(parameters.pretension_ramp_Nps > 0))
      throw std::invalid_argument("pretension_ramp_Nps must be positive");
    ramp_Nps = parameters.pretension_ramp_Nps;
    for (int j = 0; j < tendons; ++j) {
      compensation.emplace_back(robot.actuation->tendons[j], robot.limits, parameters.capstan_compensation,
                                tables[j]);
      feed_forward.emplace_back(robot.actuation->tendons[j], robot.limits, parameters.capstan_compensation,
                                tables[j], period_s);
    }
    if (parameters.tension_feedback) {
      for (const auto& t : robot.actuation->tendons) {
        if (t.load_cell.place == LoadCellPlace::kNone)
          throw std::invalid_argument("controller.tension_feedback: on needs a load cell at every tendon");
      }
      const TensionLoopGains gains = DesignTensionLoop(robot, period_s);
      if (!(gains.bandwidth_radps > 0)) {
        throw std::invalid_argument(
            "controller.tension_feedback: on has no stable gains with this rig and cycle");
      }
      for (int j = 0; j < tendons; ++j)
        feedback.emplace_back(robot.actuation->tendons[j], robot.limits, gains, j, period_s);
      if (parameters.shape_feedback) {
        double friction_Nm = 0;  // of the motor with the largest holding moment on a section
        int j = 0;
        for (const auto& section : robot.body.sections) {
          for (const auto& route : section.tendons)
            friction_Nm =
                std::max(friction_Nm, route.radius_m * FrictionAtSpool(robot.actuation->tendons[j++]));
        }
        shape_feedback.emplace(body, kShapeFeedback / gains.bandwidth_radps, kShapeRest * friction_Nm,
                               period_s);
      }
    }
    if (parameters.shape_feedback && !shape_feedback)
      throw std::invalid_argument("controller.shape_feedback: on needs tension_feedback: on");
    if (parameters.tip_feedback) {
      if (!robot.actuation->tracker)
        throw std::invalid_argument("controller.tip_feedback: on needs actuation.tracker in the robot file");
      tip_feedback.emplace(*robot.actuation->tracker, robot.body.length_m(), period_s);
    }
    if (uses_equilibrium) {
      // A torque sent in this cycle acts a cycle later, for one cycle, through the drives' torque loops.
      double lag_s = 0;
      for (const auto& t : robot.actuation->tendons) lag_s = std::max(lag_s, t.motor.torque_lag_s);
      actuation_delay_ns = period_ns + period_ns / 2 + static_cast<TimeNs>(lag_s * 1e9);
    }
  }

  // ---- the stages, in flow order ----

  void Prepare(const CycleInput& input, CycleOutput& output) const noexcept;
  void CompareWithTracker(const CycleInput& input, CycleOutput& output) noexcept;
  /// True when a command changed the mode.
  bool Admit(const CycleInput& input, CycleOutput& output) noexcept;
  void Supervise(const CycleInput& input, CycleOutput& output, bool entered) noexcept;
  void FollowTarget(const CycleInput& input, CycleOutput& output) noexcept;
  void TensionsForReference(CycleOutput& output) noexcept;
  void TensionsForEquilibrium(const CycleInput& input, CycleOutput& output) noexcept;
  double LeastTension() const noexcept;
  TendonVector MostTension() const noexcept;
  double HeldByFriction() const noexcept;
  void TensionsForMode(CycleOutput& output) noexcept;
  void TorquesForTensions(const CycleInput& input, CycleOutput& output) noexcept;
  double FrictionUncertainty_N(int tendon, const DriveFeedForward::Result& commanded) const noexcept;
  double FeedbackTorque(int tendon, const CycleInput& input, const CycleOutput& output,
                        const DriveFeedForward::Result& commanded) noexcept;

  TimeNs AheadNs() const noexcept { return trajectory.delay_ns() + actuation_delay_ns; }
  void Archive(StateArchive& archive) noexcept;
  Status CheckDrives(const CycleInput& input, CycleOutput& output) noexcept;
  Status TakeTendonsUp(const CycleInput& input, CycleOutput& output) noexcept;
  void BeginAtPretension(const CycleInput& input) noexcept;
  bool Released() const noexcept;
  void EnterMode(Mode mode, const CycleInput& input) noexcept;
  bool RampTensions(const TendonVector& towards_N) noexcept;
  bool takes_up() const noexcept {
    return supervisor.mode() == Mode::kHoming || supervisor.mode() == Mode::kCommissioning;
  }
  bool controls_shape() const noexcept {
    return supervisor.mode() == Mode::kRunning || supervisor.mode() == Mode::kHold;
  }
  Status NotReady(const CycleInput& input) const noexcept;
  void ReportNotReady(const CycleInput& input, CycleOutput& output) const noexcept;
  void ReportFault(const CycleInput& input, CycleOutput& output) const noexcept;
  bool TensionsRampDown(const CycleInput& input) const noexcept;
  int SlackTendon(const CycleOutput& output) const noexcept;
  double LimitTorque(int tendon, double fed_back_Nm, double measured_N,
                     const DriveFeedForward::Result& commanded, Status& status) noexcept;
  bool Rests(const CycleOutput& output) noexcept;
  std::int16_t RoundTorque(int tendon, double permille, std::int16_t sent) const noexcept;
  bool LostTendon(int tendon, const CycleOutput& output) noexcept;
  /// Records a status, and separately the most severe one.
  static void Report(CycleOutput& output, Status status) noexcept {
    if (static_cast<int>(status) > static_cast<int>(output.status)) output.status = status;
    for (Status& s : output.reported) {
      if (s == Status::kOk) s = status;
      if (s == status) return;
    }
  }
  NearestTip NearestTo(const Eigen::Vector3d& tip_W_m, const BendingVector& seed) noexcept;

  RobotParameters robot;
  ControllerParameters parameters;
  double period_s;
  int sections, tendons;
  double reach_tolerance_m;  // a tip target this close to the reachable set counts as reachable

  model::Body body;
  model::Body::Workspace workspace;
  std::vector<std::shared_ptr<const model::CapstanTable>> tables;
  CommandGate gate;
  TakeUp take_up;
  Supervisor supervisor;
  model::InverseKinematics kinematics;
  Trajectory trajectory;
  Reach reach;
  TensionRamp tension_ramp;
  model::TensionAllocator allocator;
  std::vector<Compensation> compensation;
  Estimator estimator;
  Guards guards;
  EquilibriumLaw equilibrium;
  std::optional<ShapeFeedback> shape_feedback;
  std::vector<DriveFeedForward> feed_forward;
  std::vector<TensionFeedback> feedback;  // per tendon; empty: off
  std::optional<TipFeedback> tip_feedback;
  bool uses_equilibrium;
  TimeNs actuation_delay_ns = 0;  // look-ahead beside the trajectory's own

  ForceMatrix force_per_tension;  // valid in this cycle only, as are q to arc_shortening_m
  TendonVector tension_N;         // commanded at the base, last output
  BendingVector goal_rad, goal_rate_radps;
  UnitVector q, dq, ddq, unit_force_Nm;
  TendonVector arc_shortening_m;
  bool balanced = false;  // the equilibrium law had a solution in the last cycle
  bool at_limit = false;  // ... with a tendon at its tension limit
  double rotor_N = 0;     // largest tension share of a rotor's acceleration lately
  // The source of the tendons' path changes in this cycle: between shape and commanded tensions, or between
  // the equilibrium law and its fallback.
  bool switched = false;
  bool waits = false;  // the reference waits for tensions ramping from commanded ones
  bool rests = false;  // the references are at rest in this cycle
  TendonVector last_reference_N, last_reference_m;  // references of the last cycle
  TendonVector shown_m;                             // displacement in the last cycle
  std::array<bool, kMaxTendons> lost{};             // tendons without tension, after a fault
  std::array<double, kMaxTendons> last_fed_back_Nm{}, fed_back_at_N{};  // last, and the tension then
  std::array<double, kMaxTendons> permille_left_over{};  // rounding remainder of the torque sent
  std::array<std::int16_t, kMaxTendons> sent_permille{};
  bool joined = false;        // tension_N follows its source without the ramp
  bool engaged = false;       // homing or commissioning with every drive enabled
  bool bare = false;          // tension_N is the pull of bare motors
  bool zeroed = false;        // displacement counts from pretension
  bool zero_known = false;    // ... did before, and the encoders have counted on since then
  bool may_be_slack = false;  // a drive failed after that: its tendon may be slack
  double ramp_Nps = 0;        // rate of tension ramps
  TimeNs stop_by_ns = 0;      // when the daemon stops: time for zero tension; else 0
  // Seen without power after the mode was entered: a drive that is still enabled must switch off before it is
  // enabled again.
  std::array<bool, kMaxTendons> was_off{};
  CommandKind source = CommandKind::kNone;
  TimeNs settled_since_ns = 0;            // or since when drives are requested to switch on
  std::int32_t disagreeing_readings = 0;  // consecutive, of the tracker with the estimate
  bool tracker_disagrees = false;
  Eigen::Vector3d compared_tip_W_m{0, 0, 0};
  std::uint32_t accepted = 0, refused = 0, missing = 0;
  Status command_status = Status::kOk;
};

// -----------------------------------------------------------------------------------------------------------

void Controller::Step(const CycleInput& input, CycleOutput& output) noexcept {
  Impl& c = *impl_;
  c.Prepare(input, output);
  c.estimator.Step(input, output);
  c.CompareWithTracker(input, output);
  const bool entered = c.Admit(input, output);
  c.Supervise(input, output, entered);
  c.FollowTarget(input, output);
  c.TensionsForReference(output);
  c.TensionsForEquilibrium(input, output);
  c.TensionsForMode(output);
  c.rests = c.Rests(output);
  c.TorquesForTensions(input, output);
  c.guards.Expect(output, c.arc_shortening_m);
}

// -----------------------------------------------------------------------------------------------------------

void Controller::Impl::Prepare(const CycleInput& input, CycleOutput& output) const noexcept {
  output = CycleOutput{};
  output.cycle = input.cycle;
  output.time_ns = input.time_ns;
  output.target_bending_rad = BendingVector::Zero(2 * sections);
  output.generalised_force_Nm = BendingVector::Zero(2 * sections);
  output.bending_estimate_rad = BendingVector::Zero(2 * sections);
  const TendonVector none = TendonVector::Zero(tendons);
  output.tension_desired_base_N = none;
  output.sliding_direction = none;
  output.tension_desired_motor_N = none;
  output.torque_desired_Nm = none;
  output.displacement_desired_m = none;
  output.displacement_m = none;
  output.tension_measured_N = none;
  output.tension_base_estimate_N = none;
  output.torque_measured_Nm = none;
}

// Compares tracker and estimate even without tip feedback: the estimate relies on undamaged tendons and a
// correct zero. Readings are late by the tracker's delay, during which the tip moves.
void Controller::Impl::CompareWithTracker(const CycleInput& input, CycleOutput& output) noexcept {
  const auto& tracker = robot.actuation->tracker;
  if (!tracker || !zeroed || !controls_shape()) {
    disagreeing_readings = 0;
    return;
  }
  const TrackerSample& seen = input.tracker;
  if (seen.valid && seen.tip_W_m.allFinite()) {
    const double moved_m = (output.tip_estimate_W_m - compared_tip_W_m).norm();
    const double late_m = moved_m * (1 + tracker->delay_s * tracker->rate_Hz);
    const double allowed_m = TipFeedback::kMaxDisagreement * robot.body.length_m() + late_m;
    const bool off = (seen.tip_W_m - output.tip_estimate_W_m).norm() > allowed_m;
    compared_tip_W_m = output.tip_estimate_W_m;
    const int most = 1 + static_cast<int>(kDisagrees_s * tracker->rate_Hz);
    disagreeing_readings = off ? std::min(disagreeing_readings + 1, most) : 0;
    tracker_disagrees = disagreeing_readings == most;
  }
  if (tracker_disagrees && disagreeing_readings > 0) Report(output, Status::kTrackerDisagrees);
}

bool Controller::Impl::Admit(const CycleInput& input, CycleOutput& output) noexcept {
  bool entered = false;
  if (input.command.kind != CommandKind::kNone) {
    double away_m = 0;
    if (input.command.kind == CommandKind::kTip && input.command.tip_W_m.allFinite()) {
      const NearestTip nearest = NearestTo(input.command.tip_W_m, goal_rad);
      away_m = nearest.distance_m;
      output.nearest_tip_W_m = nearest.tip_W_m;
    }
    command_status = gate.Admit(input.command, supervisor.mode(), input.time_ns, away_m);
    const bool clear = input.command.kind == CommandKind::kMode && input.command.mode == ModeRequest::kClear;
    if (command_status == Status::kOk && clear && TensionsRampDown(input))
      command_status = Status::kClearTooEarly;
    ++(command_status == Status::kOk ? accepted : refused);
    if (command_status != Status::kOk) Report(output, command_status);
    if (command_status == Status::kOk && input.command.kind == CommandKind::kMode) {
      Event event = Event::kHold;
      switch (input.command.mode) {
        case ModeRequest::kArm:
          event = Event::kArm;
          break;
        case ModeRequest::kDisarm:
          event = Event::kDisarm;
          break;
        case ModeRequest::kStop:
          event = Event::kDisarm;
          if (stop_by_ns == 0) stop_by_ns = input.time_ns + static_cast<TimeNs>(kStopRamp_s * kNsPerS);
          break;
        case ModeRequest::kHold:
          event = Event::kHold;
          break;
        case ModeRequest::kClear:
          event = Event::kClear;
          output.clear_drive_faults = true;
          break;
        case ModeRequest::kHome:
          event = Event::kHome;
          break;
        case ModeRequest::kCommission:
          event = Event::kCommission;
          break;
        case ModeRequest::kNotCommissioned:
        case ModeRequest::kNotAlone:
        case ModeRequest::kDriveExchanged:
          break;  // the gate refuses these
      }
      entered = supervisor.Handle(event);
      if (entered) EnterMode(supervisor.mode(), input);
    }
  }
  if (gate.Contended(input.time_ns)) Report(output, Status::kTwoSenders);
  output.commands_accepted = accepted;
  output.commands_refused = refused;
  output.command_status = command_status;
  return entered;
}

// The first tendon measured slack, from 1; 0: none.
int Controller::Impl::SlackTendon(const CycleOutput& output) const noexcept {
  for (int j = 0; j < tendons; ++j) {
    if (output.tension_measured_N[j] < parameters.guards.slack_tension_N) return j + 1;
  }
  return 0;
}

// After a fault: tensions are still ramping down.
bool Controller::Impl::TensionsRampDown(const CycleInput& input) const noexcept {
  if (supervisor.mode() != Mode::kFault || tension_N.isZero(0)) return false;
  return std::any_of(input.drive.begin(), input.drive.begin() + tendons,
                     [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
}

// Why a disconnected robot is not ready, unless its drives are still starting. Errors of a drive that answers
// take precedence over missing drives.
Status Controller::Impl::NotReady(const CycleInput& input) const noexcept {
  const auto end = input.drive.begin() + tendons;
  for (const DriveState state : {DriveState::kUnreachable, DriveState::kIdTwice, DriveState::kOtherDevice,
                                 DriveState::kMisconfigured, DriveState::kFault, DriveState::kOffline}) {
    const auto is = [state](const DriveFeedback& d) { return d.state == state; };
    if (std::any_of(input.drive.begin(), end, is)) return WhyNotReady(state);
  }
  return Status::kOk;
}

// A control loop that misses cycles makes drives appear absent, so both are reported.
void Controller::Impl::ReportNotReady(const CycleInput& input, CycleOutput& output) const noexcept {
  const Status why = NotReady(input);
  if (why == Status::kDriveAbsent && guards.behind()) Report(output, Status::kCyclesMissed);
  Report(output, why);
}

// The latched cause, and what may explain a lost drive.
void Controller::Impl::ReportFault(const CycleInput& input, CycleOutput& output) const noexcept {
  const Status cause = supervisor.cause();
  Report(output, cause);
  // A duplicate node id is detected shortly after it made the first drive seem to restart.
  if (cause == Status::kDriveLost && NotReady(input) == Status::kNodeIdTwice)
    Report(output, Status::kNodeIdTwice);
  const bool of_drives =
      cause == Status::kDriveLost || cause == Status::kDriveFault || cause == Status::kFeedbackStale;
  if (of_drives && guards.behind()) Report(output, Status::kCyclesMissed);
}

// Health of bus and drives; a fault only where it matters in this mode.
Status Controller::Impl::CheckDrives(const CycleInput& input, CycleOutput& output) noexcept {
  Status worst = Status::kOk;
  int tendon = 0;
  const auto fault = [&](Status s) {
    if (worst != Status::kOk || s == Status::kOk) return;
    worst = s;
    output.blamed_tendon = tendon;
  };
  const Mode mode = supervisor.mode();
  const bool enabling = mode == Mode::kArmed || (takes_up() && !engaged);
  const bool overdue = enabling && input.time_ns - settled_since_ns > kEnableWithin_ns;
  // A safe stop entered before the drives were on has nothing to guard.
  const bool nothing = mode == Mode::kSafeStop && tension_N.isZero(0);
  const bool powered = mode != Mode::kDisconnected && mode != Mode::kConfigured && mode != Mode::kFault &&
                       !enabling && !nothing;
  // All drives drop out when the interface does, so the interface is reported.
  const bool down = input.drive[0].state == DriveState::kUnreachable;
  if (!input.bus_ok) fault(down ? Status::kInterfaceDown : Status::kBusOff);
  for (int j = 0; j < tendons; ++j) {
    tendon = j + 1;
    const DriveFeedback& d = input.drive[j];
    const bool mismatch = d.state == DriveState::kOtherDevice || d.state == DriveState::kMisconfigured;
    const bool answering = d.state != DriveState::kOffline && d.state != DriveState::kBooting &&
                           d.state != DriveState::kUnreachable && d.state != DriveState::kIdTwice &&
                           !mismatch;
    if (d.state == DriveState::kIdTwice) fault(Status::kNodeIdShared);
    if (mismatch) fault(Status::kConfigurationMismatch);
    if (!answering) {
      fault(Status::kDriveLost);
      may_be_slack = may_be_slack || zero_known;
      zero_known = false;
    }
    if (d.state == DriveState::kFault) {
      fault(Status::kDriveFault);
      may_be_slack = true;
    }
    const bool on = was_off[j] && d.state == DriveState::kEnabled && d.age_cycles == 0;
    if (overdue && !on) fault(Status::kEnableTimedOut);
    // A drive that left operation enabled unrequested while holding a tendon is a fault as well.
    if (powered && d.state != DriveState::kEnabled) fault(Status::kDriveFault);
    if (answering && d.age_cycles > 0) {
      ++missing;
      Report(output, Status::kFeedbackMissing);
      // Without torque on the tendons a stale value is harmless; arming waits for a fresh one.
      if (powered && d.age_cycles > parameters.guards.max_missing_cycles) fault(Status::kFeedbackStale);
    }
    if (controls_shape() && output.tension_measured_N[j] < parameters.guards.slack_tension_N) {
      Report(output, Status::kSlack);
    }
  }
  output.feedback_missing = missing;
  const bool stops_shape = mode == Mode::kSafeStop && zeroed;
  const Status broken = guards.Check(input, output,
                                     {.powered = powered,
                                      .trusted = !bare,
                                      .tensioned = controls_shape() || (powered && stops_shape),
                                      .follows = controls_shape() && source != CommandKind::kTension});
  tendon = guards.tendon();
  fault(broken);
  return worst;
}

// Runs the bare motors from the time when all drives are enabled until they are off.
Status Controller::Impl::TakeTendonsUp(const CycleInput& input, CycleOutput& output) noexcept {
  Status status = Status::kOk;
  if (supervisor.mode() == Mode::kHoming) {
    status = take_up.Home(input, output, tension_N);
  } else {
    status = take_up.Watch(input);
  }
  if (supervisor.mode() == Mode::kCommissioning) {
    const bool asked = gate.target().kind == CommandKind::kTension;
    const TendonVector none = TendonVector::Zero(tendons);
    take_up.Ramp(asked ? gate.target().tension_N : none, tension_N);
  }
  if (status != Status::kOk) output.blamed_tendon = take_up.tendon();
  return status;
}

bool Controller::Impl::Released() const noexcept {
  return tension_N.maxCoeff() <= robot.limits.min_tension_N + kReleasedTension_N &&
         tension_N.minCoeff() >= -kReleasedTension_N;
}

void Controller::Impl::Supervise(const CycleInput& input, CycleOutput& output, bool entered) noexcept {
  if (input.late) Report(output, Status::kCycleLate);
  const Mode before = supervisor.mode();
  const Status health = input.drives == tendons ? CheckDrives(input, output) : Status::kDriveLost;
  bool ready = health == Status::kOk, enabled = ready;
  for (int j = 0; j < tendons && j < input.drives; ++j) {
    const DriveState s = input.drive[j].state;
    ready = ready && (s == DriveState::kReady || s == DriveState::kEnabled);
    was_off[j] = was_off[j] || s != DriveState::kEnabled;
    enabled = enabled && was_off[j] && s == DriveState::kEnabled && input.drive[j].age_cycles == 0;
  }

  Status state = health;
  if (bare && state == Status::kOk && before != Mode::kFault) state = TakeTendonsUp(input, output);
  if (takes_up() && !engaged && enabled) {
    engaged = bare = true;
    guards.Restart();
    take_up.Start(input);
    settled_since_ns = input.time_ns;
  }

  bool changed = false;
  if (state != Status::kOk) changed = supervisor.Handle(Event::kFault, state);
  // A mode entered by command in this cycle stays for at least one cycle; only a fault preempts it.
  const auto goes_on = [&] { return !changed && !entered; };
  if (goes_on() && ready) changed = supervisor.Handle(Event::kDrivesReady);
  if (goes_on() && enabled) changed = supervisor.Handle(Event::kDrivesEnabled);
  const TimeNs over_settled_ns =
      input.time_ns - settled_since_ns - static_cast<TimeNs>(parameters.pretension_settle_s * 1e9);
  if (goes_on() && before == Mode::kPretension && joined && over_settled_ns >= 0) {
    // Motion must not start on a zero of slack tendons: the minimum tension does not turn motors to take up
    // what unwound when a drive lost power under tension. Friction alone unwinds less when a robot is
    // released.
    const int slack_tendon = may_be_slack ? SlackTendon(output) : 0;
    if (slack_tendon == 0) {
      changed = supervisor.Handle(Event::kPretensioned);
    } else if (over_settled_ns >= kTautWithin_ns) {
      changed = supervisor.Handle(Event::kFault, Status::kTendonSlack);
      output.blamed_tendon = slack_tendon;
    }
  }
  if (goes_on() && before == Mode::kHoming && engaged && take_up.homed()) {
    changed = supervisor.Handle(Event::kHomed);
    if (changed) BeginAtPretension(input);
  }
  if (goes_on() && before == Mode::kSafeStop && Released()) changed = supervisor.Handle(Event::kReleased);
  if (goes_on() && before == Mode::kCommissioning && engaged) {
    // Motors must not pull on without a current command.
    const Target& pull = gate.target();
    const TimeNs until_ns = pull.kind == CommandKind::kTension ? pull.since_ns + pull.valid_for_ns
                                                               : settled_since_ns + kUnusedFor_ns;
    if (input.time_ns > until_ns) {
      changed = supervisor.Handle(Event::kDisarm);
      Report(output, Status::kCommissioningEnded);
    }
  }
  // A moving target whose stream stopped ends in hold, which only a command leaves.
  const Target& target = gate.target();
  if (goes_on() && before == Mode::kRunning && target.moving() &&
      input.time_ns - target.since_ns - target.valid_for_ns >
          static_cast<TimeNs>(parameters.guards.max_stream_silence_s * 1e9)) {
    changed = supervisor.Handle(Event::kHold);
    Report(output, Status::kCommandsSilent);
  }
  if (changed) EnterMode(supervisor.mode(), input);

  output.mode = supervisor.mode();
  switch (output.mode) {
    case Mode::kArmed:
    case Mode::kPretension:
    case Mode::kRunning:
    case Mode::kHold:
    case Mode::kSafeStop:
    case Mode::kHoming:
    case Mode::kCommissioning:
      output.drive_request = DriveRequest::kEnable;
      break;
    case Mode::kFault:
      // Tensions ramp down on the working drives; then all are disabled until cleared.
      if (Released()) tension_N.setZero();
      output.drive_request = tension_N.isZero(0) ? DriveRequest::kDisable : DriveRequest::kEnable;
      ReportFault(input, output);
      break;
    case Mode::kDisconnected:
      // In the cycle of a clear the drives have not received it yet.
      if (!output.clear_drive_faults) ReportNotReady(input, output);
      output.drive_request = DriveRequest::kDisable;
      break;
    case Mode::kConfigured:
      output.drive_request = DriveRequest::kDisable;
      break;
  }
}

void Controller::Impl::EnterMode(Mode mode, const CycleInput& input) noexcept {
  switch (mode) {
    case Mode::kDisconnected:
    case Mode::kConfigured:
    case Mode::kArmed:
    case Mode::kHoming:
    case Mode::kCommissioning:
      gate.Drop();
      tension_N.setZero();
      // Friction settles on the straight robot while tensions rise; a path left from an earlier motion would
      // cause a jump when the robot runs.
      trajectory.Reset(estimator.pretension_rad());
      rotor_N = 0;
      if (mode == Mode::kHoming || mode == Mode::kCommissioning) zero_known = false;
      joined = engaged = bare = zeroed = false;
      ramp_Nps = parameters.pretension_ramp_Nps;
      stop_by_ns = 0;
      settled_since_ns = input.time_ns;
      for (int j = 0; j < tendons; ++j) was_off[j] = input.drive[j].state != DriveState::kEnabled;
      for (int j = 0; j < tendons; ++j) {
        compensation[j].Reset(0, 0);
        // Pretension alone winds in tendon where it bends the robot.
        if (estimator.pretension_m()[j] != 0) compensation[j].Step(0, estimator.pretension_m()[j], true);
      }
      for (auto& k : feed_forward) k.Reset(0, 0);
      for (auto& k : feedback) k.Reset();
      last_fed_back_Nm.fill(0);
      fed_back_at_N.fill(0);
      equilibrium.Reset();
      if (shape_feedback) shape_feedback->Reset();
      break;
    case Mode::kPretension:
      guards.Restart();
      joined = false;
      settled_since_ns = input.time_ns;
      break;
    case Mode::kRunning:
      if (!zeroed) BeginAtPretension(input);  // else resumed from hold
      break;
    case Mode::kHold:
      gate.Drop();
      break;
    case Mode::kSafeStop:
    case Mode::kFault:
      gate.Drop();
      source = CommandKind::kNone;
      joined = false;
      break;
  }
}

// Displacement counts from the robot at pretension. When armed again the robot may be bent by friction, so a
// zero that the encoders still hold is preferred.
void Controller::Impl::BeginAtPretension(const CycleInput& input) noexcept {
  if (!zero_known) estimator.ZeroDisplacement(input);
  zero_known = true;
  may_be_slack = false;
  trajectory.Reset(estimator.pretension_rad());
  if (bare) {
    guards.Restart();
    tension_N.setConstant(robot.limits.min_tension_N);
  }
  bare = joined = false;
  zeroed = true;
}

Controller::Impl::NearestTip Controller::Impl::NearestTo(const Eigen::Vector3d& tip_W_m,
                                                         const BendingVector& seed) noexcept {
  const model::IkSolution ik = kinematics.Solve(tip_W_m, seed);
  NearestTip nearest{ik.us_vs, ik.tip_W_m, ik.distance_m, ik.status, Status::kOk};
  nearest.held = reach.Limit(nearest.bending_rad);
  if (nearest.held != Status::kOk) {
    nearest.tip_W_m = kinematics.Tip(nearest.bending_rad);
    nearest.distance_m = (nearest.tip_W_m - tip_W_m).norm();
  }
  return nearest;
}

// Target -> bending goal (inverse kinematics for tip targets) -> jerk-limited reference. The goal is taken
// ahead by the delay of the trajectory's averages, so that a moving target is followed without lag.
void Controller::Impl::FollowTarget(const CycleInput& input, CycleOutput& output) noexcept {
  const Target& target = gate.target();
  output.target_tip_W_m.setConstant(std::numeric_limits<double>::quiet_NaN());
  const CommandKind before = source;
  if (supervisor.mode() == Mode::kRunning && target.kind != CommandKind::kNone) source = target.kind;
  switched = (before == CommandKind::kTension) != (source == CommandKind::kTension);
  if (switched && source != CommandKind::kTension && controls_shape()) {
    trajectory.Reset(output.bending_estimate_rad);  // back from tension control: start where the robot is
    joined = false;
    waits = true;
  }
  if (joined || !controls_shape() || source == CommandKind::kTension) waits = false;

  if (!controls_shape() || target.kind == CommandKind::kNone || target.kind == CommandKind::kTension) {
    goal_rate_radps.setZero();
    trajectory.AdvanceToRest();
    goal_rad = trajectory.followed();
  } else {
    const TimeNs ahead_ns = input.time_ns + (parameters.trajectory.look_ahead ? AheadNs() : 0);
    const double smoothing_s2 = uses_equilibrium ? trajectory.smoothing_s2() : 0;
    const BendingVector goal_before = goal_rad;
    if (target.kind == CommandKind::kTip) {
      output.target_tip_W_m = target.TipAt(input.time_ns);
      const Eigen::Vector3d smoothed_W_m = smoothing_s2 * target.tip_acceleration_W_mps2;
      const NearestTip nearest = NearestTo(target.TipAt(ahead_ns) - smoothed_W_m, goal_before);
      goal_rad = nearest.bending_rad;
      // Distance caused by look-ahead and smoothing alone is not reported.
      const double own_m = smoothed_W_m.norm();
      output.target_distance_m = std::max(0.0, nearest.distance_m - own_m);
      if (nearest.reached != Status::kTargetUnreachable || nearest.distance_m > reach_tolerance_m + own_m)
        Report(output, nearest.reached);
      Report(output, nearest.held);
    } else {
      goal_rad = target.bending_rad;
      if (target.moving()) goal_rad += target.bending_rate_radps * target.ElapsedS(ahead_ns);
      if (target.bending_acceleration_radps2.size() == goal_rad.size())
        goal_rad -= smoothing_s2 * target.bending_acceleration_radps2;
      for (int k = 0; k < sections; ++k) {
        const double bend = goal_rad.segment<2>(2 * k).norm();
        if (bend > robot.limits.max_bending_rad) {
          goal_rad.segment<2>(2 * k) *= robot.limits.max_bending_rad / bend;
          Report(output, Status::kLimitedBending);
        }
      }
      Report(output, reach.Limit(goal_rad));
    }
    // Rate of the goal itself; a goal replaced by a new command jumps and has none.
    const bool continued =
        target.moving() && before == source && target.since_ns + period_s * 1e9 < input.time_ns;
    if (continued) {
      goal_rate_radps = (goal_rad - goal_before) / period_s;
    } else if (!target.moving()) {
      goal_rate_radps.setZero();
    }
    // Tensions still ramp to those that hold this shape, so the reference waits.
    if (waits) {
      trajectory.AdvanceToRest();
    } else {
      Report(output, trajectory.Advance(goal_rad, goal_rate_radps, target.speed_radps,
                                        reach.Rate_radps(trajectory.followed(), target.moving())));
    }
    if (target.moving() && input.time_ns - target.since_ns > target.valid_for_ns) {
      Report(output, Status::kCommandExpired);
    }
  }
  output.target_bending_rad = goal_rad;
  output.reference = trajectory.reference();
}

// Kane's equations of the arc motion give the force that the tendons must produce; the allocation gives the
// least tensions.
void Controller::Impl::TensionsForReference(CycleOutput& output) noexcept {
  const BendingReference& r = output.reference;
  body.SpreadBending(r.position_rad, q);
  body.SpreadBending(r.velocity_radps, dq);
  body.SpreadBending(r.acceleration_radps2, ddq);
  output.reference_tip_W_m = body.TipPose(q).p_WA;
  body.TendonShortening(q, output.displacement_desired_m);
  arc_shortening_m = output.displacement_desired_m;

  body.InverseDynamics(q, dq, ddq, unit_force_Nm, workspace);
  body.ProjectForce(unit_force_Nm, output.generalised_force_Nm);
  model::SectionForcePerTension(body, r.position_rad, force_per_tension);
  const auto allocated =
      allocator.Allocate(force_per_tension, output.generalised_force_Nm, robot.limits.min_tension_N,
                         CommandedLimits(robot.limits).max_tension_base_N);
  output.tension_desired_base_N = allocated.tension_N;
  // Tendons at minimum tension are normal where the backbone alone returns the robot.
  if (controls_shape() && allocated.bound != Status::kLimitedTensionMin) Report(output, allocated.bound);
}

// A tendon at minimum tension goes slack when the rotor's acceleration takes more tension than it has; the
// spool then runs free and jerks the tendon. So the minimum tension grows with the rotors' acceleration.
double Controller::Impl::LeastTension() const noexcept {
  return std::min(robot.limits.min_tension_N + rotor_N, 0.5 * robot.limits.max_tension_base_N);
}

// A tension that hits its bound would stop the robot while the rotors run on, jerk the tendons and leave
// tension in dry friction. The trajectory keeps planned motions below the bound, but corrections by shape and
// tip feedback are not planned. So each tension approaches its bound at room / gather_s, as a motion comes to
// rest; far from the bound the limit rises quickly, so as not to restrict planned motions.
TendonVector Controller::Impl::MostTension() const noexcept {
  const double bound_N = CommandedLimits(robot.limits).max_tension_base_N;
  const TendonVector bounds_N = TendonVector::Constant(tendons, bound_N);
  if (!joined || !(shape_feedback || tip_feedback)) return bounds_N;
  const TendonVector room_N = (bounds_N - tension_N).cwiseMax(0);
  const double share = period_s / trajectory.gather_s();
  const TendonVector far = room_N / (kNearBound * bound_N);
  return tension_N + (share * (room_N + room_N.cwiseProduct(far.cwiseAbs2()))).cwiseMin(room_N);
}

// Section moment that dry friction of a motor and its pulleys holds at these tensions.
double Controller::Impl::HeldByFriction() const noexcept {
  double most_Nm = 0;
  int j = 0;
  for (const auto& section : robot.body.sections) {
    for (const auto& route : section.tendons) {
      const double pulleys_N = 0.5 * (tables[j]->Pull(tension_N[j]) - tables[j]->Release(tension_N[j]));
      const double friction_N = FrictionAtSpool(robot.actuation->tendons[j]) + pulleys_N;
      most_Nm = std::max(most_Nm, route.radius_m * friction_N);
      ++j;
    }
  }
  return most_Nm;
}

// Replaces the arc by the robot's equilibrium shape. Without a solution the arc's tensions are used; the ramp
// bridges the change.
void Controller::Impl::TensionsForEquilibrium(const CycleInput& input, CycleOutput& output) noexcept {
  if (!uses_equilibrium) return;
  if (!controls_shape()) {
    equilibrium.Reset();
    balanced = at_limit = false;
    return;
  }
  Eigen::Vector3d shift_W_m = Eigen::Vector3d::Zero();
  if (tip_feedback) {
    Report(output,
           tip_feedback->Step(input.tracker, input.time_ns, actuation_delay_ns, output.reference_tip_W_m,
                              output.tip_estimate_W_m, equilibrium.tip_u(), equilibrium.tip_v(),
                              joined && source != CommandKind::kTension, at_limit));
    shift_W_m = tip_feedback->shift_W_m();
  }
  const BendingVector lacking_Nm =
      shape_feedback ? shape_feedback->moment_Nm() : BendingVector::Zero(2 * sections);
  if (source == CommandKind::kTension) {
    // Friction follows the shape that the tensions produce.
    const bool before = balanced;
    balanced = equilibrium.Follow(tension_N, lacking_Nm);
    if (balanced != before) switched = true;
    at_limit = false;
    output.displacement_desired_m = last_reference_m;
    if (balanced) body.TendonShortening(equilibrium.q(), output.displacement_desired_m);
    arc_shortening_m = output.displacement_desired_m;
    return;
  }
  const Status status = equilibrium.Solve(output.reference, output.tension_desired_base_N, LeastTension(),
                                          MostTension(), shift_W_m, lacking_Nm);
  const bool answered = status != Status::kEquilibriumNotFound;
  // The tendons' path changes its source here, which is no motion.
  if (answered != balanced) {
    joined = false;
    switched = true;
  }
  balanced = answered;
  at_limit = status == Status::kLimitedTensionMax || status == Status::kLimitedTensionMin;
  if (status != Status::kLimitedTensionMin) Report(output, status);
  if (!answered) return;
  output.tension_desired_base_N = equilibrium.tension_N();
  body.TendonShortening(equilibrium.q(), output.displacement_desired_m);
  if (shape_feedback) {
    Report(output, shape_feedback->Step(output.reference.position_rad, output.displacement_desired_m,
                                        estimator.shortening_m(), estimator.weight(), force_per_tension,
                                        equilibrium.SectionCompliance(), HeldByFriction(), joined, at_limit));
  }
  body.TendonForce(equilibrium.q(), equilibrium.tension_N(), unit_force_Nm);
  body.ProjectForce(unit_force_Nm, output.generalised_force_Nm);
}

// Moves tension_N towards a goal at the configured rate; true once there.
bool Controller::Impl::RampTensions(const TendonVector& towards_N) noexcept {
  const double step_N = ramp_Nps * period_s;
  bool there = true;
  for (int j = 0; j < tendons; ++j) {
    const double gap_N = towards_N[j] - tension_N[j];
    there = there && std::abs(gap_N) <= step_N;
    tension_N[j] += std::clamp(gap_N, -step_N, step_N);
  }
  return there;
}

// Tensions commanded in each mode. After a change of source they ramp to the new one, then follow it exactly.
void Controller::Impl::TensionsForMode(CycleOutput& output) noexcept {
  const TendonVector pretension = TendonVector::Constant(tendons, robot.limits.min_tension_N);
  switch (supervisor.mode()) {
    case Mode::kDisconnected:
    case Mode::kConfigured:
    case Mode::kArmed:
      tension_N.setZero();
      break;
    case Mode::kPretension:
      if (joined) {
        tension_N = pretension;
      } else {
        joined = RampTensions(pretension);
        settled_since_ns = output.time_ns;
      }
      break;
    case Mode::kRunning:
    case Mode::kHold:
      if (source == CommandKind::kTension) {
        const TendonVector commanded =
            gate.target().kind == CommandKind::kTension ? gate.target().tension_N : tension_N;
        const double least_N = robot.limits.min_tension_N,
                     most_N = CommandedLimits(robot.limits).max_tension_base_N;
        const TendonVector goal_N = commanded.cwiseMax(least_N).cwiseMin(most_N);
        if (uses_equilibrium) {
          if (switched) tension_ramp.Start(tension_N);
          tension_N = tension_ramp.Step(goal_N, ramp_Nps * period_s);
        } else {
          RampTensions(goal_N);
        }
        if (commanded.minCoeff() < least_N) Report(output, Status::kLimitedTensionMin);
        if (commanded.maxCoeff() > most_N) Report(output, Status::kLimitedTensionMax);
        joined = false;
      } else if (joined) {
        tension_N = output.tension_desired_base_N;
      } else {
        joined = RampTensions(output.tension_desired_base_N);
      }
      break;
    case Mode::kHoming:
    case Mode::kCommissioning:
      break;  // commanded by TakeTendonsUp
    case Mode::kSafeStop:
    case Mode::kFault:
      // By the clock, so that skipped cycles do not delay the stop.
      if (stop_by_ns > 0) {
        const double left_s = std::max(ToSeconds(stop_by_ns - output.time_ns), period_s);
        ramp_Nps = std::max(ramp_Nps, (tension_N.maxCoeff() - robot.limits.min_tension_N) / left_s);
      }
      RampTensions(tension_N.cwiseMin(robot.limits.min_tension_N).cwiseMax(0));
      break;
  }
  output.tension_desired_base_N = tension_N;
}

// Uncertainty of the motor-side tension until the pulleys have slid fully, after arming or a reversal:
// tracking a guess of friction with a motor-side cell would move the base tension.
double Controller::Impl::FrictionUncertainty_N(int j,
                                               const DriveFeedForward::Result& commanded) const noexcept {
  if (!parameters.capstan_compensation) return 0;
  const double range_N = tables[j]->Pull(tension_N[j]) - tables[j]->Release(tension_N[j]);
  return 0.5 * (1 - std::abs(commanded.sliding)) * range_N;
}

// Torque from the load cell's error, compared on the cell's side of the pulleys.
double Controller::Impl::FeedbackTorque(int j, const CycleInput& input, const CycleOutput& output,
                                        const DriveFeedForward::Result& commanded) noexcept {
  const bool acts = controls_shape();
  const bool at_motor = robot.actuation->tendons[j].load_cell.place == LoadCellPlace::kMotorSide;
  const double fed_back =
      feedback[j].Step(input.drive[j], output.tension_measured_N[j],
                       {.cell_N = at_motor ? commanded.tension_motor_N : tension_N[j],
                        .motor_velocity_radps = commanded.motor_velocity_radps,
                        .uncertainty_N = at_motor ? FrictionUncertainty_N(j, commanded) : 0,
                        .rests = rests},
                       acts);
  if (acts) {
    last_fed_back_Nm[j] = fed_back;
    fed_back_at_N[j] = tension_N[j];
    return fed_back;
  }
  // On the way down the correction shrinks with the tension; dropping it at once would jerk a motor stronger
  // than its file states. After a fault, which may be the cell's, it adds no pull.
  const Mode mode = supervisor.mode();
  if ((mode != Mode::kSafeStop && mode != Mode::kFault) || !(fed_back_at_N[j] > 0)) return 0;
  const double left_Nm = last_fed_back_Nm[j] * std::clamp(tension_N[j] / fed_back_at_N[j], 0., 1.);
  return mode == Mode::kFault ? std::min(0., left_Nm) : left_Nm;
}

// Limits the torque to the drive's current, and from below to what leaves the tendon without tension, unless
// the motion pays out or the cell shows more than its own error: otherwise a small cell offset would unwind
// the spool. The feedback is informed of the saturation.
double Controller::Impl::LimitTorque(int j, double fed_back_Nm, double measured_N,
                                     const DriveFeedForward::Result& commanded, Status& status) noexcept {
  const TendonDriveParameters& drive = robot.actuation->tendons[j];
  const double most_Nm = compensation[j].max_torque_Nm();
  const double unpulled_Nm = commanded.unloaded_Nm - kPaidOut * drive.motor.coulomb_friction_Nm;
  const double certain_Nm = drive.SpoolTravelPerMotorRad() * std::max(0., measured_N - kCellDoubt_N);
  const double least_Nm = std::max(-most_Nm, std::min(commanded.torque_Nm, unpulled_Nm) - certain_Nm);
  const double torque_Nm = commanded.torque_Nm + fed_back_Nm;
  const double bounded_Nm = std::clamp(torque_Nm, least_Nm, most_Nm);
  feedback[j].Limited(torque_Nm - bounded_Nm);
  if (std::abs(bounded_Nm) == most_Nm && torque_Nm != bounded_Nm) status = Status::kLimitedTorque;
  return bounded_Nm;
}

void Controller::Impl::TorquesForTensions(const CycleInput& input, CycleOutput& output) noexcept {
  const bool moving = controls_shape() && !switched && (uses_equilibrium || source != CommandKind::kTension);
  double most_rotor_N = 0;
  for (int j = 0; j < tendons; ++j) {
    Compensation::Result r;
    if (bare) {
      r.tension_motor_N = std::max(0., tension_N[j]);
      r.torque_Nm = take_up.Torque(j, tension_N[j]);
    } else if (uses_equilibrium) {
      const auto commanded =
          feed_forward[j].Step(tension_N[j], output.displacement_desired_m[j], arc_shortening_m[j],
                               moving || supervisor.mode() == Mode::kPretension);
      r = commanded;
      most_rotor_N = std::max(most_rotor_N, std::abs(commanded.rotor_N));
      if (!feedback.empty())
        r.torque_Nm = LimitTorque(j, FeedbackTorque(j, input, output, commanded),
                                  output.tension_measured_N[j], commanded, r.status);
    } else {
      r = compensation[j].Step(tension_N[j], output.displacement_desired_m[j], moving);
    }
    if (LostTendon(j, output)) r.torque_Nm = 0;
    output.sliding_direction[j] = r.sliding;
    output.tension_desired_motor_N[j] = r.tension_motor_N;
    output.torque_desired_Nm[j] = r.torque_Nm;
    Report(output, r.status);
  }
  rotor_N = std::max(most_rotor_N, rotor_N - kRotorFades_Nps * period_s);
  shown_m = output.displacement_m;
  if (!output.torque_desired_Nm.allFinite()) {
    // Never send a torque that is not a number: release everything at once.
    output.torque_desired_Nm.setZero();
    tension_N.setZero();
    trajectory.Reset(BendingVector::Zero(2 * sections));
    supervisor.Handle(Event::kFault, Status::kInternalNotFinite);
    output.mode = supervisor.mode();
    output.drive_request = DriveRequest::kDisable;
    Report(output, Status::kInternalNotFinite);
  }
  const bool powered = output.drive_request == DriveRequest::kEnable && output.mode != Mode::kArmed &&
                       !(takes_up() && !engaged);
  for (int j = 0; j < tendons; ++j) {
    const double permille =
        powered ? output.torque_desired_Nm[j] / robot.actuation->tendons[j].drive.rated_torque_Nm * 1000 : 0;
    output.torque_target_permille[j] = RoundTorque(j, permille, sent_permille[j]);
    const bool carried = uses_equilibrium && !rests && permille != 0;
    const double left_over = permille + permille_left_over[j] - output.torque_target_permille[j];
    permille_left_over[j] = carried ? std::clamp(left_over, -0.5, 0.5) : 0;
    sent_permille[j] = output.torque_target_permille[j];
  }
}

// After a fault the tensions ramp down. A spool that has lost its tendon's tension would wind it in and jerk
// it beyond every limit, so its motor is released until the cell shows tension again. Either sensor may be
// the cause of the fault, so both must agree, and neither is fed back.
bool Controller::Impl::LostTendon(int j, const CycleOutput& output) noexcept {
  const bool slack = supervisor.mode() == Mode::kFault && zeroed && !bare &&
                     output.tension_measured_N[j] < parameters.guards.slack_tension_N;
  const bool runs = std::abs(output.displacement_m[j] - shown_m[j]) > kLost_mps * period_s;
  lost[j] = slack && (lost[j] || runs);
  return lost[j];
}

// Neither shape nor tension references move, within kRest.
bool Controller::Impl::Rests(const CycleOutput& output) noexcept {
  const double moved_m = (output.displacement_desired_m - last_reference_m).cwiseAbs().maxCoeff();
  const double changed_N = (tension_N - last_reference_N).cwiseAbs().maxCoeff();
  last_reference_m = output.displacement_desired_m;
  last_reference_N = tension_N;
  return moved_m < kRest_mps * period_s && changed_N < kRest_Nps * period_s;
}

// While the robot moves, the rounding remainder carries over to the next cycle: one torque step on the bus is
// 14 mN of tendon tension here, and the mean over a few cycles matters. At rest this dither would shake the
// robot through its dry friction, so the target is held until it differs by more than rounding and noise.
std::int16_t Controller::Impl::RoundTorque(int tendon, double permille, std::int16_t sent) const noexcept {
  permille = std::clamp(permille, -32767., 32767.);
  if (!uses_equilibrium) return static_cast<std::int16_t>(std::lround(permille));
  if (rests && permille != 0 && std::abs(permille - sent) < kHeldPermille) return sent;
  return static_cast<std::int16_t>(
      std::lround(std::clamp(permille + permille_left_over[tendon], -32767., 32767.)));
}

// All state kept between cycles; a missing member shows as a difference in replay.
void Controller::Impl::Archive(StateArchive& a) noexcept {
  gate.Archive(a);
  supervisor.Archive(a);
  take_up.Archive(a);
  trajectory.Archive(a);
  for (Compensation& k : compensation) k.Archive(a);
  if (uses_equilibrium) {
    for (DriveFeedForward& k : feed_forward) k.Archive(a);
    for (TensionFeedback& k : feedback) k.Archive(a);
    if (tip_feedback) tip_feedback->Archive(a);
    equilibrium.Archive(a);
    tension_ramp.Archive(a);
    if (shape_feedback) shape_feedback->Archive(a);
    a.Value(balanced);
    a.Value(at_limit);
    a.Value(rotor_N);
    for (int j = 0; j < tendons; ++j) {
      a.Value(last_fed_back_Nm[j]);
      a.Value(fed_back_at_N[j]);
      a.Value(permille_left_over[j]);
      a.Value(sent_permille[j]);
    }
    a.Vector(last_reference_N, {tendons});
    a.Vector(last_reference_m, {tendons});
  }
  estimator.Archive(a);
  guards.Archive(a);
  a.Vector(tension_N, {tendons});
  a.Vector(shown_m, {tendons});
  for (int j = 0; j < tendons; ++j) a.Value(lost[j]);
  a.Vector(goal_rad, {2 * sections});
  a.Vector(goal_rate_radps, {2 * sections});
  a.Value(joined);
  a.Value(waits);
  a.Value(engaged);
  a.Value(bare);
  a.Value(zeroed);
  a.Value(zero_known);
  a.Value(may_be_slack);
  a.Value(ramp_Nps);
  a.Value(stop_by_ns);
  for (int j = 0; j < tendons; ++j) a.Value(was_off[j]);
  a.Choice(source, CommandKind::kMode);
  a.Value(disagreeing_readings);
  a.Value(tracker_disagrees);
  a.Vector(compared_tip_W_m);
  a.Value(settled_since_ns);
  a.Value(accepted);
  a.Value(refused);
  a.Value(missing);
  a.Choice(command_status, static_cast<Status>(999));
}

// -----------------------------------------------------------------------------------------------------------

Controller::Controller(const RobotParameters& robot, const ControllerParameters& parameters, TimeNs period_ns)
    : impl_(std::make_unique<Impl>(robot, parameters, period_ns)) {}

Controller::~Controller() = default;

TimeNs Controller::look_ahead_ns() const noexcept { return impl_->AheadNs(); }

std::size_t Controller::state_bytes() const noexcept {
  StateArchive archive;
  impl_->Archive(archive);
  return archive.bytes();
}

void Controller::SaveState(std::span<std::byte> bytes) const noexcept {
  auto archive = StateArchive::Saver(bytes);
  impl_->Archive(archive);
}

bool Controller::LoadState(std::span<const std::byte> bytes) noexcept {
  if (bytes.size() != state_bytes()) return false;
  auto archive = StateArchive::Loader(bytes);
  impl_->Archive(archive);
  return archive.ok();
}

}  // namespace tendril::control
