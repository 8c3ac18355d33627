// `tendril follow`: streams a planned motion to a running daemon in real time, as an operator's program
// would, and says how well it was followed. Knows nothing of the robot behind the daemon.
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <memory>
#include <stdexcept>
#include <thread>

#include "commands.h"
#include "lcm_options.h"
#include "motion.h"
#include "tendril/config/config.h"
#include "tendril/io/client.h"
#include "tendril_lcm/state_t.hpp"

namespace tendril::tools {
namespace {

struct FollowOptions {
  LcmOptions lcm;
  std::string motion, robot;
};

volatile std::sig_atomic_t interrupted = 0;

constexpr TimeNs kCommandPeriod_ns = 10 * kNsPerMs;
// Long enough for a late scheduler, short enough that a dead stream stops the robot soon.
constexpr TimeNs kValidFor_ns = 100 * kNsPerMs;
constexpr TimeNs kSilence_ns = kNsPerS, kArmingAtMost_ns = 10 * kNsPerS;
// Further from the robot's reach than this, the motion was made for another robot.
constexpr double kOutOfReach_m = 1e-3;
// Closer than this to the motion's first target, the robot's reference counts as there.
constexpr double kArrivedBending_rad = 1e-4;
constexpr TimeNs kStillBefore_ns = 500 * kNsPerMs, kApproachAtMost_ns = 30 * kNsPerS;

std::int64_t EpochUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

class Follower {
 public:
  explicit Follower(const FollowOptions& options)
      : options_(options),
        motion_(MakeMotion(options.motion, config::LoadRobot(options.robot).body)),
        client_(options.lcm.url, options.lcm.prefix) {
    client_.OnState([this](const tendril_lcm::state_t& s) {
      state_ = s;
      heard_ns_ = clock_.Now();
      ++states_;
    });
  }

  void Run() {
    const TimeNs asked_ns = clock_.Now();
    while (states_ == 0 && clock_.Now() - asked_ns < 2 * kNsPerS) client_.Handle(20);
    if (states_ == 0) {
      throw std::runtime_error(
          fmt::format("no daemon answers on {} ({}_STATE) within 2 s; is tendrild running, with the same "
                      "--lcm and --prefix?",
                      options_.lcm.url, options_.lcm.prefix));
    }
    while (Arming() && clock_.Now() - asked_ns < kArmingAtMost_ns) client_.Handle(20);
    CheckRunning();
    fmt::print("{}\n", motion_->description());
    Approach();
    Stream();
  }

 private:
  bool Arming() const {
    return !interrupted && (state_.mode == tendril_lcm::state_t::MODE_ARMED ||
                            state_.mode == tendril_lcm::state_t::MODE_PRETENSION);
  }

  void CheckRunning() {
    client_.Handle(0);
    if (interrupted) {
      throw std::runtime_error(fmt::format("stopped by {}: the robot holds the last target",
                                           interrupted == SIGTERM ? "SIGTERM" : "Ctrl-C"));
    }
    if (clock_.Now() - heard_ns_ > kSilence_ns) {
      throw std::runtime_error(
          "the daemon fell silent for a second: look at its log; the robot holds the last target");
    }
    if (state_.mode != tendril_lcm::state_t::MODE_RUNNING) {
      throw std::runtime_error(fmt::format("the daemon is in mode {}{}: {}", state_.mode_text,
                                           state_.status ? " (" + state_.status_text + ")" : std::string(),
                                           state_.mode == tendril_lcm::state_t::MODE_FAULT
                                               ? "clear it with `tendril send clear`, then arm"
                                               : "arm it first with `tendril send arm`"));
    }
    if (state_.target_distance_m > kOutOfReach_m) {
      throw std::runtime_error(
          fmt::format("the daemon's robot cannot reach this motion by {:.1f} mm: is {} its robot file? The "
                      "robot holds the last target",
                      1e3 * state_.target_distance_m, options_.robot));
    }
  }

  void Send(Command command) {
    command.sequence = io::SequenceFromTime();
    command.valid_for_ns = kValidFor_ns;
    if (!client_.Send(command, EpochUs())) {
      throw std::runtime_error("LCM could not send on " + options_.lcm.url +
                               ": check the address and the route");
    }
  }

  // To the next point of the sending grid; points that a late scheduler passed over are left out, not made up
  // for.
  void SleepToNext(TimeNs& next_ns) const {
    const TimeNs now_ns = clock_.Now();
    while (next_ns <= now_ns) next_ns += kCommandPeriod_ns;
    std::this_thread::sleep_for(std::chrono::nanoseconds(next_ns - now_ns));
  }

  // To the first target, until the reference has rested there.
  void Approach() {
    const TimeNs start_ns = clock_.Now();
    TimeNs moving_ns = start_ns, next_ns = start_ns;
    while (clock_.Now() - moving_ns < kStillBefore_ns) {
      Send(motion_->Start());
      SleepToNext(next_ns);
      CheckRunning();
      double gap = 0;
      for (std::size_t i = 0; i < state_.bending_target_rad.size(); ++i) {
        gap = std::max(gap, std::abs(state_.bending_target_rad[i] - state_.bending_desired_rad[i]));
      }
      if (gap > kArrivedBending_rad) moving_ns = clock_.Now();
      if (clock_.Now() - start_ns > kApproachAtMost_ns) {
        throw std::runtime_error("the motion's first target was not reached within 30 s");
      }
    }
  }

  void Stream() {
    const TimeNs start_ns = clock_.Now();
    TimeNs next_ns = start_ns;
    double sum2 = 0, largest = 0;
    int count = 0, shown_s = -1;
    for (double t_s = 0; t_s < motion_->duration_s(); t_s = ToSeconds(clock_.Now() - start_ns)) {
      Send(motion_->At(t_s));
      SleepToNext(next_ns);
      CheckRunning();
      const Eigen::Map<const Eigen::Vector3d> estimate(state_.tip_estimate_W_m),
          desired(state_.tip_desired_W_m);
      if (t_s >= motion_->judged_from_s() && t_s <= motion_->judged_until_s() && estimate.allFinite()) {
        const double error = (estimate - desired).norm();
        sum2 += error * error;
        largest = std::max(largest, error);
        ++count;
      }
      if (static_cast<int>(t_s) > shown_s) {
        shown_s = static_cast<int>(t_s);
        fmt::print(stderr, "{:3d} of {:.0f} s\n", shown_s, motion_->duration_s());
      }
    }
    fmt::print("followed; estimated tip less desired tip: rms {:.3f} mm, largest {:.3f} mm over {} samples\n",
               count ? 1e3 * std::sqrt(sum2 / count) : 0.0, 1e3 * largest, count);
  }

  FollowOptions options_;
  std::unique_ptr<Motion> motion_;
  MonotonicClock clock_;
  io::Client client_;
  tendril_lcm::state_t state_{};
  TimeNs heard_ns_ = 0;
  std::uint64_t states_ = 0;
};

}  // namespace

void AddFollowCommand(CLI::App& app) {
  auto options = std::make_shared<FollowOptions>();
  CLI::App* command =
      app.add_subcommand("follow", "Stream a planned motion to a running, armed daemon in real time");
  command->add_option("motion", options->motion, "circle or planar, the motions of `tendril demo`")
      ->required()
      ->check(CLI::IsMember({"circle", "planar"}));
  command->add_option("--robot", options->robot, "the daemon's robot file: the motion's size follows from it")
      ->required();
  AddLcmOptions(*command, options->lcm);
  command->callback([options] {
    std::signal(SIGINT, [](int signal) { interrupted = signal; });
    std::signal(SIGTERM, [](int signal) { interrupted = signal; });
    Follower(*options).Run();
  });
}

}  // namespace tendril::tools
