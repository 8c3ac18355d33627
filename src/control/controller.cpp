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
#include "tendril/control/tension_lead.h"
#include "tendril/control/tip_feedback.h"
#include "tendril/control/trajectory.h"
#include "tendril/model/inverse.h"

namespace tendril::control {
namespace {

using ForceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, kMaxTendons>;

// Nearer than this to pretension a tendon counts as released.
constexpr double kReleasedTension_N = 1e-6;
// While commissioning: without a pull asked for, the drives are disabled again after this.
constexpr TimeNs kUnusedFor_ns = 2 * kNsPerS;
// Drives take some hundredths of a second to switch on; the master gives one up after 2 s, and tells more.
constexpr TimeNs kEnableWithin_ns = 3 * kNsPerS;
// As long may a tendon take to show its least tension after that was commanded and should have settled.
constexpr TimeNs kTautWithin_ns = 2 * kNsPerS;
// Slower than this a robot is led nowhere: a micrometre of tendon in ten seconds.
constexpr double kRest_mps = 1e-7, kRest_Nps = 1e-3;
constexpr double kHeldPermille = 0.8;
// Of the motor's own friction, which alone holds a spool without tension; a file may take it for too much.
constexpr double kPaidOut = 0.5;
constexpr double kCellDoubt_N = 0.5;
// A spool that goes at this speed while its cell shows no pull has lost its tendon.
constexpr double kLost_mps = 0.01;
// Time constant of the feedback of shape, over that of the loops of tension below it; and of the motors' dry
// friction what it leaves alone at rest.
constexpr double kShapeFeedback = 10, kShapeRest = 0.1;
// A robot that was led fast keeps its tendons' pull for a while: it may be led on, and it swings.
constexpr double kRotorFades_Nps = 3;
constexpr double kDisagrees_s = 0.5;  // tracker and tendons, before it is told
constexpr double kNearBound = 0.125;  // of a tension's bound, where room for it begins to count
constexpr double kStopRamp_s = 0.9;   // a daemon that is ended has this long for tensions to go down

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

LimitParameters LedLimits(LimitParameters limits) {
  limits.max_tension_base_N = std::max(kLedShare * limits.max_tension_base_N, limits.min_tension_N);
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

// One table a tendon; tendons over equal pulleys share theirs.
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
  // What a robot makes of a tip: the nearest that its arcs reach, brought back to what tensions hold.
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
        reach(robot, body, LedLimits(robot.limits), trajectory.gather_s(),
              parameters.law == ControlLaw::kEquilibrium),
        tension_lead(body, reach.UnpulledRate_radps(), trajectory.gather_s(), period_s),
        allocator(tendons, 2 * sections),
        estimator(robot, body, tables, period_s),
        guards(robot, parameters.guards, period_ns, body, tables),
        equilibrium(body, LedLimits(robot.limits)),
        uses_equilibrium(parameters.law == ControlLaw::kEquilibrium),
        force_per_tension(2 * sections, tendons),
        tension_N(TendonVector::Zero(tendons)),
        goal_rad(BendingVector::Zero(2 * sections)),
        goal_rate_radps(BendingVector::Zero(2 * sections)),
        q(UnitVector::Zero(body.dof())),
        dq(q),
        ddq(q),
        unit_force_Nm(q),
        led_N(tension_N),
        led_m(tension_N),
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
        double friction_Nm = 0;  // of the motor that holds a section most
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
      // A torque sent in this cycle acts a cycle later, for a cycle, through the drives' torque loops.
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
  double Unsure(int tendon, const DriveFeedForward::Result& wanted) const noexcept;
  double FedBack(int tendon, const CycleInput& input, const CycleOutput& output,
                 const DriveFeedForward::Result& wanted) noexcept;

  TimeNs AheadNs() const noexcept { return trajectory.delay_ns() + actuation_delay_ns; }
  void Remember(StateArchive& archive) noexcept;
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
  bool StillPulls(const CycleInput& input) const noexcept;
  int HangingTendon(const CycleOutput& output) const noexcept;
  double Bounded(int tendon, double fed_back_Nm, double measured_N, const DriveFeedForward::Result& wanted,
                 Status& status) noexcept;
  bool Rests(const CycleOutput& output) noexcept;
  std::int16_t Rounded(int tendon, double permille, std::int16_t sent) const noexcept;
  bool LostTendon(int tendon, const CycleOutput& output) noexcept;
  /// Keeps what there is to say, and apart the most severe of it.
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
  double reach_tolerance_m;  // a tip target closer to reach than this counts as reachable

  model::Body body;
  model::Body::Workspace workspace;
  std::vector<std::shared_ptr<const model::CapstanTable>> tables;
  CommandGate gate;
  TakeUp take_up;
  Supervisor supervisor;
  model::InverseKinematics kinematics;
  Trajectory trajectory;
  Reach reach;
  TensionLead tension_lead;
  model::TensionAllocator allocator;
  std::vector<Compensation> compensation;
  Estimator estimator;
  Guards guards;
  EquilibriumLaw equilibrium;
  std::optional<ShapeFeedback> shape_feedback;
  std::vector<DriveFeedForward> feed_forward;
  std::vector<TensionFeedback> feedback;  // a tendon; empty: off
  std::optional<TipFeedback> tip_feedback;
  bool uses_equilibrium;
  TimeNs actuation_delay_ns = 0;  // looked ahead beside the trajectory's own

  ForceMatrix force_per_tension;  // of this cycle only, as are q to arc_shortening_m
  TendonVector tension_N;         // wanted at the base, as put out last
  BendingVector goal_rad, goal_rate_radps;
  UnitVector q, dq, ddq, unit_force_Nm;
  TendonVector arc_shortening_m;
  bool balanced = false;  // the equilibrium law had an answer in the last cycle
  bool at_limit = false;  // ... which had a tendon at its greatest tension
  double rotor_N = 0;     // the most that a rotor's acceleration took of a tendon of late
  // The tendons' path is another one from this cycle on: tensions are commanded or no more, or the
  // equilibrium law has an answer or none.
  bool switched = false;
  bool waits = false;                    // the reference, for tensions on their way from commanded ones
  bool rests = false;                    // nothing is led anywhere in this cycle
  TendonVector led_N, led_m;             // where the tendons were led in the last cycle
  TendonVector shown_m;                  // displacement, in the last cycle
  std::array<bool, kMaxTendons> lost{};  // tendons, after a fault
  std::array<double, kMaxTendons> last_fed_back_Nm{}, fed_back_at_N{};  // last, and the tension wanted then
  std::array<double, kMaxTendons> permille_left_over{};  // of torque, by rounding to what the bus carries
  std::array<std::int16_t, kMaxTendons> sent_permille{};
  bool joined = false;      // tension_N follows its source without the ramp
  bool engaged = false;     // homing or commissioning, and every drive has been enabled
  bool bare = false;        // tension_N is the pull of bare motors
  bool zeroed = false;      // displacement counts from pretension
  bool zero_known = false;  // ... did so before, and the encoders have counted on since
  bool let_go = false;      // since then a drive was lost or in fault: its tendon may hang
  double ramp_Nps = 0;      // of tensions that are led somewhere
  TimeNs stop_by_ns = 0;    // of a daemon that is ended: when tensions are to be down; 0: it is not
  // Seen without power since the mode was entered: a drive that is still on when it is asked for anew goes
  // off first.
  std::array<bool, kMaxTendons> was_off{};
  CommandKind source = CommandKind::kNone;
  TimeNs settled_since_ns = 0;            // or since when drives are asked to switch on
  std::int32_t disagreeing_readings = 0;  // of the tracker with the estimate, in a row
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

// Where a tracker publishes, whatever is made of it: the estimate counts on tendons that hang where they
// should and a zero that was the straight robot. Readings are late by the tracker's delay, in which the tip
// goes on.
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
    if (command_status == Status::kOk && clear && StillPulls(input)) command_status = Status::kClearTooEarly;
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
          break;  // the gate lets none through
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

// The first tendon whose tension is measured and is none, from 1; 0: none.
int Controller::Impl::HangingTendon(const CycleOutput& output) const noexcept {
  for (int j = 0; j < tendons; ++j) {
    if (output.tension_measured_N[j] < parameters.guards.slack_tension_N) return j + 1;
  }
  return 0;
}

// After a fault: tensions that are still led down.
bool Controller::Impl::StillPulls(const CycleInput& input) const noexcept {
  if (supervisor.mode() != Mode::kFault || tension_N.isZero(0)) return false;
  return std::any_of(input.drive.begin(), input.drive.begin() + tendons,
                     [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
}

// Why a disconnected robot stays so, when it is not that its drives are still starting. What is wrong with a
// drive that answers is said before what may be missing.
Status Controller::Impl::NotReady(const CycleInput& input) const noexcept {
  const auto end = input.drive.begin() + tendons;
  for (const DriveState state : {DriveState::kUnreachable, DriveState::kIdTwice, DriveState::kOtherDevice,
                                 DriveState::kMisconfigured, DriveState::kFault, DriveState::kOffline}) {
    const auto is = [state](const DriveFeedback& d) { return d.state == state; };
    if (std::any_of(input.drive.begin(), end, is)) return WhyNotReady(state);
  }
  return Status::kOk;
}

// A loop that misses its own cycles keeps drives from answering in time, so that this is said with it.
void Controller::Impl::ReportNotReady(const CycleInput& input, CycleOutput& output) const noexcept {
  const Status why = NotReady(input);
  if (why == Status::kDriveAbsent && guards.behind()) Report(output, Status::kCyclesMissed);
  Report(output, why);
}

// The latched cause, and what explains that a drive seems lost.
void Controller::Impl::ReportFault(const CycleInput& input, CycleOutput& output) const noexcept {
  const Status cause = supervisor.cause();
  Report(output, cause);
  // A second drive with its id shows a moment after it made the first seem to restart.
  if (cause == Status::kDriveLost && NotReady(input) == Status::kNodeIdTwice)
    Report(output, Status::kNodeIdTwice);
  const bool of_drives =
      cause == Status::kDriveLost || cause == Status::kDriveFault || cause == Status::kFeedbackStale;
  if (of_drives && guards.behind()) Report(output, Status::kCyclesMissed);
}

// Health of bus and drives; a fault only where it means one in this mode.
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
  // What leads no tension down has nothing left to guard: a safe stop before the drives were on.
  const bool nothing = mode == Mode::kSafeStop && tension_N.isZero(0);
  const bool powered = mode != Mode::kDisconnected && mode != Mode::kConfigured && mode != Mode::kFault &&
                       !enabling && !nothing;
  // Drives fall together with what connects them, which is to be named.
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
      let_go = let_go || zero_known;
      zero_known = false;
    }
    if (d.state == DriveState::kFault) {
      fault(Status::kDriveFault);
      let_go = true;
    }
    const bool on = was_off[j] && d.state == DriveState::kEnabled && d.age_cycles == 0;
    if (overdue && !on) fault(Status::kEnableTimedOut);
    // A drive that left operation enabled on its own while it should hold a tendon is a fault as well.
    if (powered && d.state != DriveState::kEnabled) fault(Status::kDriveFault);
    if (answering && d.age_cycles > 0) {
      ++missing;
      Report(output, Status::kFeedbackMissing);
      // Without torque on the tendons an old value harms nobody; arming waits for a fresh one.
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

// Bare motors, from the moment in which all of them can pull until they are off.
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
    take_up.Lead(asked ? gate.target().tension_N : none, tension_N);
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
  // A mode that a command led to in this cycle is seen before it leads on; a fault waits for nothing.
  const auto goes_on = [&] { return !changed && !entered; };
  if (goes_on() && ready) changed = supervisor.Handle(Event::kDrivesReady);
  if (goes_on() && enabled) changed = supervisor.Handle(Event::kDrivesEnabled);
  const TimeNs over_settled_ns =
      input.time_ns - settled_since_ns - static_cast<TimeNs>(parameters.pretension_settle_s * 1e9);
  if (goes_on() && before == Mode::kPretension && joined && over_settled_ns >= 0) {
    // Nothing is led on a zero of tendons that hang: the least tension does not turn the motors that would
    // take up what fell off when a drive let go under tension. What friction alone leaves to a released robot
    // is less.
    const int hangs = let_go ? HangingTendon(output) : 0;
    if (hangs == 0) {
      changed = supervisor.Handle(Event::kPretensioned);
    } else if (over_settled_ns >= kTautWithin_ns) {
      changed = supervisor.Handle(Event::kFault, Status::kTendonSlack);
      output.blamed_tendon = hangs;
    }
  }
  if (goes_on() && before == Mode::kHoming && engaged && take_up.homed()) {
    changed = supervisor.Handle(Event::kHomed);
    if (changed) BeginAtPretension(input);
  }
  if (goes_on() && before == Mode::kSafeStop && Released()) changed = supervisor.Handle(Event::kReleased);
  if (goes_on() && before == Mode::kCommissioning && engaged) {
    // Nobody asks for anything, or no more: motors do not pull on unwatched.
    const Target& pull = gate.target();
    const TimeNs until_ns = pull.kind == CommandKind::kTension ? pull.since_ns + pull.valid_for_ns
                                                               : settled_since_ns + kUnusedFor_ns;
    if (input.time_ns > until_ns) {
      changed = supervisor.Handle(Event::kDisarm);
      Report(output, Status::kCommissioningEnded);
    }
  }
  // A sender that promised a motion and went silent does not come back unasked.
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
      // Tensions ramp down on the drives that still can; then everything is disabled and stays so.
      if (Released()) tension_N.setZero();
      output.drive_request = tension_N.isZero(0) ? DriveRequest::kDisable : DriveRequest::kEnable;
      ReportFault(input, output);
      break;
    case Mode::kDisconnected:
      // In the cycle of a clear the drives have not heard of it yet.
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
      // Friction settles on the straight robot while tensions rise; an earlier motion's path would be left in
      // a jump when the robot runs.
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
        // Pretension alone winds in what bends a robot that is not pulled every way.
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

// The robot at pretension is where displacement counts from. Armed again it is as bent as friction
// left it: a zero that the encoders have counted on from is the better one.
void Controller::Impl::BeginAtPretension(const CycleInput& input) noexcept {
  if (!zero_known) estimator.ZeroDisplacement(input);
  zero_known = true;
  let_go = false;
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

// Target -> bending goal (inverse kinematics for tip targets) -> jerk-limited reference. The goal is taken as
// far ahead as the trajectory's averages delay, so a moving target is followed without lag.
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
      // What look-ahead and smoothing take a moving target off the reachable surface is not worth a word.
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
    // How fast the goal itself moves; a goal that was replaced by a new command is a jump, not a motion.
    const bool continued =
        target.moving() && before == source && target.since_ns + period_s * 1e9 < input.time_ns;
    if (continued) {
      goal_rate_radps = (goal_rad - goal_before) / period_s;
    } else if (!target.moving()) {
      goal_rate_radps.setZero();
    }
    // Tensions are still on their way to what holds this shape: a reference that went ahead of them would
    // have nothing to follow it.
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

// Kane's equations of the arc motion give the force the tendons must produce; the allocation gives the least
// tensions.
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
                         LedLimits(robot.limits).max_tension_base_N);
  output.tension_desired_base_N = allocated.tension_N;
  // Where the backbone alone brings a robot back, tendons that have let go are nothing to be told of.
  if (controls_shape() && allocated.bound != Status::kLimitedTensionMin) Report(output, allocated.bound);
}

// A tendon at its least tension goes slack when the rotor's acceleration takes more of it than it has, or is
// felt a little late; then the spool loses its hold and comes back with a blow. So the faster the robot is
// led to and fro, the more every tendon keeps.
double Controller::Impl::LeastTension() const noexcept {
  return std::min(robot.limits.min_tension_N + rotor_N, 0.5 * robot.limits.max_tension_base_N);
}

// A tension that ran into its bound would stop the robot at once; the rotors, which cannot, would snatch the
// tendons, and dry friction keep what they pulled. Motions are planned so that none does; what feedback of
// shape and tip asks for beside them nobody planned, so each tension comes up to its bound as a motion comes
// to rest, at room / gather_s; far from it that is let go quickly, for there it would hold planned ones back.
TendonVector Controller::Impl::MostTension() const noexcept {
  const double bound_N = LedLimits(robot.limits).max_tension_base_N;
  const TendonVector bounds_N = TendonVector::Constant(tendons, bound_N);
  if (!joined || !(shape_feedback || tip_feedback)) return bounds_N;
  const TendonVector room_N = (bounds_N - tension_N).cwiseMax(0);
  const double share = period_s / trajectory.gather_s();
  const TendonVector far = room_N / (kNearBound * bound_N);
  return tension_N + (share * (room_N + room_N.cwiseProduct(far.cwiseAbs2()))).cwiseMin(room_N);
}

// Of a section's moment, what dry friction of a motor and of its pulleys holds at these tensions.
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

// The shape that the robot really takes on in place of the arc. Without an answer the arc's tensions stay;
// the tensions are led over at the ramp's rate from one to the other.
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
    // Friction follows the shape that the tensions make.
    const bool before = balanced;
    balanced = equilibrium.Follow(tension_N, lacking_Nm);
    if (balanced != before) switched = true;
    at_limit = false;
    output.displacement_desired_m = led_m;
    if (balanced) body.TendonShortening(equilibrium.q(), output.displacement_desired_m);
    arc_shortening_m = output.displacement_desired_m;
    return;
  }
  const Status status = equilibrium.Solve(output.reference, output.tension_desired_base_N, LeastTension(),
                                          MostTension(), shift_W_m, lacking_Nm);
  const bool answered = status != Status::kEquilibriumNotFound;
  // The path of the tendons is another one from here on, which is no motion.
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

// What the mode makes of the tensions. Where the source of tensions changes they are led over at the ramp's
// rate, then follow it exactly.
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
        const TendonVector wanted =
            gate.target().kind == CommandKind::kTension ? gate.target().tension_N : tension_N;
        const double least_N = robot.limits.min_tension_N,
                     most_N = LedLimits(robot.limits).max_tension_base_N;
        const TendonVector goal_N = wanted.cwiseMax(least_N).cwiseMin(most_N);
        if (uses_equilibrium) {
          if (switched) tension_lead.Start(tension_N);
          tension_N = tension_lead.Step(goal_N, ramp_Nps * period_s);
        } else {
          RampTensions(goal_N);
        }
        if (wanted.minCoeff() < least_N) Report(output, Status::kLimitedTensionMin);
        if (wanted.maxCoeff() > most_N) Report(output, Status::kLimitedTensionMax);
        joined = false;
      } else if (joined) {
        tension_N = output.tension_desired_base_N;
      } else {
        joined = RampTensions(output.tension_desired_base_N);
      }
      break;
    case Mode::kHoming:
    case Mode::kCommissioning:
      break;  // led by TakeTendonsUp
    case Mode::kSafeStop:
    case Mode::kFault:
      // By the clock: cycles that were skipped are made up for.
      if (stop_by_ns > 0) {
        const double left_s = std::max(ToSeconds(stop_by_ns - output.time_ns), period_s);
        ramp_Nps = std::max(ramp_Nps, (tension_N.maxCoeff() - robot.limits.min_tension_N) / left_s);
      }
      RampTensions(tension_N.cwiseMin(robot.limits.min_tension_N).cwiseMax(0));
      break;
  }
  output.tension_desired_base_N = tension_N;
}

// Until the pulleys have slid through, after arming or a reversal, nobody knows well what friction holds
// them; a cell before them may differ by all that is open, and holding it to a guess would move the base off.
double Controller::Impl::Unsure(int j, const DriveFeedForward::Result& wanted) const noexcept {
  if (!parameters.capstan_compensation) return 0;
  const double range_N = tables[j]->Pull(tension_N[j]) - tables[j]->Release(tension_N[j]);
  return 0.5 * (1 - std::abs(wanted.sliding)) * range_N;
}

// What the load cell's error adds, compared where the cell sits.
double Controller::Impl::FedBack(int j, const CycleInput& input, const CycleOutput& output,
                                 const DriveFeedForward::Result& wanted) noexcept {
  const bool acts = controls_shape();
  const bool at_motor = robot.actuation->tendons[j].load_cell.place == LoadCellPlace::kMotorSide;
  const double fed_back = feedback[j].Step(input.drive[j], output.tension_measured_N[j],
                                           {.cell_N = at_motor ? wanted.tension_motor_N : tension_N[j],
                                            .motor_velocity_radps = wanted.motor_velocity_radps,
                                            .unsure_N = at_motor ? Unsure(j, wanted) : 0,
                                            .rests = rests},
                                           acts);
  if (acts) {
    last_fed_back_Nm[j] = fed_back;
    fed_back_at_N[j] = tension_N[j];
    return fed_back;
  }
  // On the way down it goes with the tension: what was taken off a motor that is stronger than told would
  // come back as a jerk. A fault may be the cell's own; then it adds no pull.
  const Mode mode = supervisor.mode();
  if ((mode != Mode::kSafeStop && mode != Mode::kFault) || !(fed_back_at_N[j] > 0)) return 0;
  const double left_Nm = last_fed_back_Nm[j] * std::clamp(tension_N[j] / fed_back_at_N[j], 0., 1.);
  return mode == Mode::kFault ? std::min(0., left_Nm) : left_Nm;
}

// Within the drive's current, and no less than what leaves the tendon without a pull, unless the motion
// itself pays out, or the cell shows more than its own error: a rope cannot be pushed, and a cell that shows
// a little too much would otherwise unwind its spool. The feedback learns what it lost.
double Controller::Impl::Bounded(int j, double fed_back_Nm, double measured_N,
                                 const DriveFeedForward::Result& wanted, Status& status) noexcept {
  const TendonDriveParameters& drive = robot.actuation->tendons[j];
  const double most_Nm = compensation[j].max_torque_Nm();
  const double unpulled_Nm = wanted.unloaded_Nm - kPaidOut * drive.motor.coulomb_friction_Nm;
  const double sure_Nm = drive.SpoolTravelPerMotorRad() * std::max(0., measured_N - kCellDoubt_N);
  const double least_Nm = std::max(-most_Nm, std::min(wanted.torque_Nm, unpulled_Nm) - sure_Nm);
  const double torque_Nm = wanted.torque_Nm + fed_back_Nm;
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
      const auto wanted =
          feed_forward[j].Step(tension_N[j], output.displacement_desired_m[j], arc_shortening_m[j],
                               moving || supervisor.mode() == Mode::kPretension);
      r = wanted;
      most_rotor_N = std::max(most_rotor_N, std::abs(wanted.rotor_N));
      if (!feedback.empty())
        r.torque_Nm =
            Bounded(j, FedBack(j, input, output, wanted), output.tension_measured_N[j], wanted, r.status);
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
    // Nothing may reach a drive that is not a number: release everything at once.
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
    output.torque_target_permille[j] = Rounded(j, permille, sent_permille[j]);
    const bool carried = uses_equilibrium && !rests && permille != 0;
    const double left_over = permille + permille_left_over[j] - output.torque_target_permille[j];
    permille_left_over[j] = carried ? std::clamp(left_over, -0.5, 0.5) : 0;
    sent_permille[j] = output.torque_target_permille[j];
  }
}

// After a fault the tensions are led down. A spool that runs without its tendon, though, would wind it in
// with all its momentum, and a blow at the end beyond every limit: its motor is let go until the cell shows
// a pull again. Either sensor may be what the fault is about, so both must say so, and neither is fed back.
bool Controller::Impl::LostTendon(int j, const CycleOutput& output) noexcept {
  const bool slack = supervisor.mode() == Mode::kFault && zeroed && !bare &&
                     output.tension_measured_N[j] < parameters.guards.slack_tension_N;
  const bool runs = std::abs(output.displacement_m[j] - shown_m[j]) > kLost_mps * period_s;
  lost[j] = slack && (lost[j] || runs);
  return lost[j];
}

// Neither shape nor tensions are led anywhere, or so slowly that nobody sees it.
bool Controller::Impl::Rests(const CycleOutput& output) noexcept {
  const double moved_m = (output.displacement_desired_m - led_m).cwiseAbs().maxCoeff();
  const double changed_N = (tension_N - led_N).cwiseAbs().maxCoeff();
  led_m = output.displacement_desired_m;
  led_N = tension_N;
  return moved_m < kRest_mps * period_s && changed_N < kRest_Nps * period_s;
}

// What rounding took from one cycle the next one gets while the robot moves: a step of the bus is 14 mN of
// tendon tension here, and the mean over a few cycles is what moves it. At rest that to and fro would shake
// the robot through its own dry friction: there the target stands until it is off by more than rounding and
// noise make it.
std::int16_t Controller::Impl::Rounded(int tendon, double permille, std::int16_t sent) const noexcept {
  permille = std::clamp(permille, -32767., 32767.);
  if (!uses_equilibrium) return static_cast<std::int16_t>(std::lround(permille));
  if (rests && permille != 0 && std::abs(permille - sent) < kHeldPermille) return sent;
  return static_cast<std::int16_t>(
      std::lround(std::clamp(permille + permille_left_over[tendon], -32767., 32767.)));
}

// Whatever outlives a cycle; a member that is missing here shows as a difference in replay.
void Controller::Impl::Remember(StateArchive& a) noexcept {
  gate.Remember(a);
  supervisor.Remember(a);
  take_up.Remember(a);
  trajectory.Remember(a);
  for (Compensation& k : compensation) k.Remember(a);
  if (uses_equilibrium) {
    for (DriveFeedForward& k : feed_forward) k.Remember(a);
    for (TensionFeedback& k : feedback) k.Remember(a);
    if (tip_feedback) tip_feedback->Remember(a);
    equilibrium.Remember(a);
    tension_lead.Remember(a);
    if (shape_feedback) shape_feedback->Remember(a);
    a.Value(balanced);
    a.Value(at_limit);
    a.Value(rotor_N);
    for (int j = 0; j < tendons; ++j) {
      a.Value(last_fed_back_Nm[j]);
      a.Value(fed_back_at_N[j]);
      a.Value(permille_left_over[j]);
      a.Value(sent_permille[j]);
    }
    a.Vector(led_N, {tendons});
    a.Vector(led_m, {tendons});
  }
  estimator.Remember(a);
  guards.Remember(a);
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
  a.Value(let_go);
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
  impl_->Remember(archive);
  return archive.bytes();
}

void Controller::SaveState(std::span<std::byte> bytes) const noexcept {
  auto archive = StateArchive::Saver(bytes);
  impl_->Remember(archive);
}

bool Controller::LoadState(std::span<const std::byte> bytes) noexcept {
  if (bytes.size() != state_bytes()) return false;
  auto archive = StateArchive::Loader(bytes);
  impl_->Remember(archive);
  return archive.ok();
}

}  // namespace tendril::control
