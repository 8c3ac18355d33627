#include "tendril/experiment/closed_loop.h"

#include <stdexcept>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/daemon/wiring.h"
#include "tendril/io/connection.h"

namespace tendril::experiment {
namespace {

// Runs in simulated time: LCM's in-process transport carries the messages.
LcmParameters InProcess(LcmParameters lcm) {
  lcm.url = "memq://";
  return lcm;
}

}  // namespace

DaemonParameters FitBus(DaemonParameters daemon, const RobotParameters& robot) {
  const std::vector<NodeParameters> given = std::exchange(daemon.bus.nodes, {});
  for (int j = 0; j < robot.body.tendons(); ++j) {
    if (!robot.actuation->HasDrive(j)) continue;
    // The kind of drive is that of the file's tendon, or of its first one.
    NodeParameters node;
    for (const NodeParameters& other : given) {
      if (&other == &given.front() || other.tendon == j + 1) node = other;
    }
    node.node_id = robot.actuation->tendons[static_cast<std::size_t>(j)].node_id;
    node.tendon = j + 1;
    node.motor_reversed = node.encoder_reversed = false;
    daemon.bus.nodes.push_back(std::move(node));
  }
  const canopen::BusBudget budget =
      canopen::ComputeBusBudget(daemon.bus, daemon::DriveSetups(robot, daemon.bus));
  if (budget.load > daemon.bus.max_load) {
    const TimeNs cycle_ns = budget.min_cycle_ns_for_these_drives;
    daemon.bus.feedback_deadline_ns = daemon.bus.feedback_deadline_ns * cycle_ns / daemon.bus.cycle_ns;
    daemon.bus.cycle_ns = cycle_ns;
  }
  return daemon;
}

ClosedLoop::ClosedLoop(const ClosedLoopOptions& options) : bus_(clock_) {
  const RobotParameters& robot = options.controller_robot;
  if (!robot.actuation) {
    throw std::invalid_argument(
        "robot '" + robot.name +
        "' has no actuation (motors, drives, tendons); use a rig file such as rig_60mm.yaml");
  }
  if (robot.body.tendons() != options.plant_robot.body.tendons()) {
    throw std::invalid_argument(
        "the controller's robot has " + std::to_string(robot.body.tendons()) + " tendons, the plant's " +
        std::to_string(options.plant_robot.body.tendons()) + ": give two files of the same robot");
  }
  const auto& plant = options.plant_robot.actuation;
  if (plant && plant->drives() != robot.actuation->drives()) {
    throw std::invalid_argument("the controller's robot has " + std::to_string(robot.actuation->drives()) +
                                " motors, the plant's " + std::to_string(plant->drives()) +
                                ": give two files of the same robot");
  }
  daemon_ = options.keep_nodes ? options.daemon : FitBus(options.daemon, robot);
  rig_ = std::make_unique<rig::VirtualRig>(options.plant_robot, bus_.AddPort(), options.plant,
                                           rig::DriveProfiles(daemon_.bus.nodes));
  setups_ = daemon::DriveSetups(robot, daemon_.bus);
  master_ = std::make_unique<canopen::Master>(daemon_.bus, setups_, bus_.AddPort());
  controller_ = std::make_unique<control::Controller>(robot, daemon_.controller, daemon_.bus.cycle_ns);
  cycle_ = std::make_unique<daemon::ControlCycle>(
      *controller_, *master_, clock_, robot, daemon_.bus, [this](TimeNs) {
        if (answered_) return false;  // the drives answer at once or not at all
        rig_->Poll(clock_.Now());
        answered_ = true;
        return true;
      });
  gateway_ = std::make_unique<io::Gateway>(InProcess(daemon_.lcm), daemon::ShapeOf(robot), clock_);
  gateway_->OnCommand([this](const Command& command) { pending_ = command; });
  gateway_->OnTracker([this](const TrackerSample& sample) { tracker_ = sample; });
  tracker_channel_ = io::ChannelName(daemon_.lcm.channel_prefix, "TRACKER");
  operator_ = std::make_unique<io::Client>(gateway_->lcm(), daemon_.lcm.channel_prefix);
  if (!options.log_path.empty()) log_ = std::make_unique<io::LogWriter>(*gateway_, options.log_path, clock_);
  gateway_->PublishRun({.robot_yaml = config::ToYaml(robot),
                        .daemon_yaml = config::ToYaml(daemon_),
                        .version = std::string(Version()),
                        .git_revision = std::string(GitRevision()),
                        .start_utime = 0});
  master_->Start(clock_.Now());
}

const CycleRecord& ClosedLoop::Step() {
  clock_.Advance(daemon_.bus.cycle_ns);
  gateway_->Handle(0);  // commands in
  const rt::CycleStart start{
      .cycle = cycle_count_++, .grid_ns = clock_.Now(), .wake_latency_ns = 0, .missed = 0};
  answered_ = false;
  cycle_->Run(start, pending_, tracker_, record_);
  pending_ = Command{};
  tracker_ = TrackerSample{};

  gateway_->PublishState(record_);
  gateway_->PublishCycle(record_);
  ForwardEvents();
  PublishTracker();
  return record_;
}

// As from a tracker's computer: a message that the controller receives in its next cycle.
void ClosedLoop::PublishTracker() {
  auto reading = rig_->TakeTrackerReading();
  if (reading && tracker_way_) reading = tracker_way_(*reading);
  if (!reading) return;
  if (!io::SendTracker(*gateway_->lcm(), tracker_channel_, *reading, reading->time_ns / kNsPerUs)) {
    throw std::runtime_error("a tracker reading could not be published");
  }
}

void ClosedLoop::ForwardEvents() {
  canopen::BusEvent event;
  while (master_->PopEvent(&event)) {
    last_event_ = event.text.data();
    gateway_->PublishEvent(event.time_ns, event.status, "bus", last_event_);
  }
}

void ClosedLoop::Send(ModeRequest request) {
  Command command;
  command.kind = CommandKind::kMode;
  command.mode = request;
  Send(command);
}

void ClosedLoop::Send(Command target) {
  target.sequence = ++sequence_;
  target.valid_for_ns = 100 * kNsPerMs;
  // Simulated time has no epoch: the time of arrival counts.
  if (!operator_->Send(target, 0)) throw std::runtime_error("a command could not be published");
}

void ClosedLoop::ArmAndPretension() {
  StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kConfigured; }, 10,
            "the drives to be configured");
  Send(ModeRequest::kArm);
  StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kRunning; }, 10,
            "arming and pretension");
}

void ClosedLoop::ArmBehindBrakes() {
  rig_->HoldBrakes(true);
  ArmAndPretension();
  rig_->HoldBrakes(false);
}

void ClosedLoop::DisarmAndWait() {
  Send(ModeRequest::kDisarm);
  StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kConfigured; }, 30, "the safe stop");
}

void ClosedLoop::ThrowTimeout(const char* what) const {
  const CycleOutput& o = record_.output;
  throw std::runtime_error(
      "gave up waiting for " + std::string(what) + " at t = " + std::to_string(now_s()) + " s: mode " +
      std::string(ModeText(o.mode)) + ", status " + std::to_string(static_cast<int>(o.status)) + " " +
      std::string(StatusText(o.status)) + (last_event_.empty() ? "" : "; last event: " + last_event_));
}

}  // namespace tendril::experiment
