// tendril send: one command to a daemon over LCM, and what became of it. Knows nothing of the robot: the
// daemon judges.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <stdexcept>
#include <vector>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "tendril/core/cycle.h"
#include "tendril/core/status.h"
#include "tendril/core/tip_unit.h"
#include "tendril/io/client.h"
#include "tendril_lcm/state_t.hpp"

namespace tendril::tools {
namespace {

// A daemon that is started takes two seconds to be sure that it is alone, and its drives some more.
constexpr double kTimeout_s = 2, kArmTimeout_s = 15;
// Of any value of a target: what is more means no robot, in whatever unit.
constexpr double kMostValue = 1e6;
constexpr TimeNs kLeastForAnswer_ns = 500 * kNsPerMs;

struct SendOptions {
  LcmOptions lcm;
  double speed_radps = 0;
  double valid_for_s = 1;
  double timeout_s = -1;  // not given
  std::vector<double> values;
};

std::int64_t EpochUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

// One line for people: where the robot is now, and which limit acts if one does.
std::string Describe(const tendril_lcm::state_t& state) {
  std::string text = "accepted; mode " + state.mode_text;
  for (const std::int16_t number : state.reported) {
    const auto status = static_cast<Status>(number);
    // That another's targets are refused is no answer to this command.
    if (status != Status::kTwoSenders) text += fmt::format("; {} {}", number, StatusText(status));
  }
  if (state.target_distance_m > 0) {
    text += fmt::format(" ({:.2f} mm away from the requested point)", 1e3 * state.target_distance_m);
  }
  return text;
}

TimeNs ToNs(double seconds) { return static_cast<TimeNs>(seconds * static_cast<double>(kNsPerS)); }

bool Is(const Command& command, ModeRequest request) {
  return command.kind == CommandKind::kMode && command.mode == request;
}

// What is waited for is told when it is not there soon.
class Waiting {
 public:
  void For(const std::string& what, TimeNs tell_after_ns) {
    if (what == told_ || clock_.Now() < since_ns_ + tell_after_ns) return;
    told_ = what;
    fmt::print(stderr, "waiting for {}\n", what);
  }

 private:
  MonotonicClock clock_;
  TimeNs since_ns_ = clock_.Now();
  std::string told_;
};

// What waiting does not mend.
bool NeedsAHand(Status reason) {
  return reason == Status::kDriveHasFault || reason == Status::kOtherDevice ||
         reason == Status::kDriveMisconfigured || reason == Status::kNodeIdTwice;
}

// A robot whose daemon or drives are still starting is armed when they are ready. A drive in fault will not
// be without its operator. Throws when they are not ready in time.
void AwaitDrives(const SendOptions& o, io::Client& client, const tendril_lcm::state_t& latest,
                 double timeout_s) {
  // A daemon that waits itself tells so once a second.
  constexpr TimeNs kTellAfter_ns = 300 * kNsPerMs, kTellNobodyAfter_ns = 1500 * kNsPerMs;
  const MonotonicClock clock;
  const TimeNs end_ns = clock.Now() + ToNs(timeout_s);
  Waiting waiting;
  Status reason = Status::kOk;
  while (clock.Now() < end_ns) {
    client.Handle(20);
    if (latest.utime == 0) {
      waiting.For(fmt::format("a daemon on {} ({}_STATE){}{}", o.lcm.url, o.lcm.prefix,
                              client.waits().empty() ? "" : ", which is ", client.waits()),
                  client.waits().empty() ? kTellNobodyAfter_ns : 0);
      continue;
    }
    reason = io::ReasonForMode(latest);
    if (latest.mode != tendril_lcm::state_t::MODE_DISCONNECTED || NeedsAHand(reason)) return;
    waiting.For(reason == Status::kOk ? "the drives" : fmt::format("the drives: {}", StatusText(reason)),
                kTellAfter_ns);
  }
  if (latest.utime == 0) throw std::runtime_error(NobodyAnswers(o.lcm, timeout_s, client));
  throw std::runtime_error(
      reason == Status::kOk
          ? fmt::format("the drives did not start within {:g} s; see the daemon's log, or wait longer "
                        "(--timeout)",
                        timeout_s)
          : fmt::format("the drives did not start within {:g} s: {} ({}); {}", timeout_s, StatusText(reason),
                        static_cast<int>(reason), StatusRemedy(reason)));
}

// An arm that comes when it is done already, or about to be, is as good as the first.
bool ArmedAlready(const tendril_lcm::state_t& s) {
  return s.command_status == static_cast<std::int16_t>(Status::kCommandWrongMode) &&
         (s.mode == tendril_lcm::state_t::MODE_ARMED || s.mode == tendril_lcm::state_t::MODE_PRETENSION ||
          s.mode == tendril_lcm::state_t::MODE_RUNNING);
}

void Send(const SendOptions& o, Command command) {
  command.sender = io::SenderOfProcess();
  command.valid_for_ns = ToNs(o.valid_for_s);
  command.speed_radps = o.speed_radps;

  const bool arm = Is(command, ModeRequest::kArm), clear = Is(command, ModeRequest::kClear);
  const double timeout_s = o.timeout_s >= 0 ? o.timeout_s : arm ? kArmTimeout_s : kTimeout_s;

  io::Client client(o.lcm.url, o.lcm.prefix);
  bool answered = false, settled = false;
  tendril_lcm::state_t latest{}, answer{};
  client.OnState([&](const tendril_lcm::state_t& state) {
    latest = state;
    if (settled || command.sequence == 0 || state.command_sequence != io::SequenceOf(command)) return;
    answered = true;
    // Drives that a clear starts again take a moment, in which nothing is to be said yet.
    settled = !clear || state.command_status != 0 || state.mode != tendril_lcm::state_t::MODE_DISCONNECTED;
    answer = state;
  });
  const MonotonicClock clock;
  TimeNs end_ns = clock.Now() + ToNs(timeout_s);
  if (arm && timeout_s > 0) {
    AwaitDrives(o, client, latest, timeout_s);
    end_ns = std::max(end_ns, clock.Now() + kLeastForAnswer_ns);
  }
  command.sequence = io::SequenceFromTime();
  if (!client.Send(command, EpochUs())) {
    throw std::runtime_error("LCM could not send the command on " + o.lcm.url);
  }
  while (!settled && clock.Now() < end_ns) client.Handle(20);
  if (timeout_s == 0) return;
  if (latest.utime == 0) throw std::runtime_error(NobodyAnswers(o.lcm, timeout_s, client));
  if (!answered) {
    throw std::runtime_error(fmt::format(
        "the daemon is running but did not receive the command within {:g} s; try again", timeout_s));
  }
  const bool already = arm && ArmedAlready(answer);
  if (answer.command_status != 0 && !already) {
    std::string more;
    for (const std::int16_t number : answer.reported) {
      const auto status = static_cast<Status>(number);
      // That there are two senders is what a target was refused for.
      if (number != answer.command_status && status != Status::kTwoSenders)
        more += fmt::format(": {} {}; {}", number, StatusText(status), StatusRemedy(status));
    }
    throw std::runtime_error(fmt::format("{} ({}, mode {}{})", answer.command_status_text,
                                         answer.command_status, answer.mode_text, more));
  }
  // Targets are taken once pretension is reached.
  const auto on_its_way = [&] {
    return latest.mode == tendril_lcm::state_t::MODE_ARMED ||
           latest.mode == tendril_lcm::state_t::MODE_PRETENSION;
  };
  while (arm && on_its_way() && clock.Now() < end_ns) client.Handle(20);
  if (arm && latest.mode != tendril_lcm::state_t::MODE_RUNNING) {
    const Status reason = io::ReasonForMode(latest);
    throw std::runtime_error(
        fmt::format("armed, but {} mode {}: {}",
                    on_its_way() ? fmt::format("after {:g} s still in", timeout_s) : "then", latest.mode_text,
                    reason == Status::kOk ? std::string("see the daemon's log; send arm again")
                                          : fmt::format("{} ({}); {}", StatusText(reason),
                                                        static_cast<int>(reason), StatusRemedy(reason))));
  }
  if (already) {
    fmt::print("armed already; mode {}\n", latest.mode_text);
  } else {
    fmt::print("{}\n", Describe(arm ? latest : answer));
  }
}

template <class Vector>
Vector ToVector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

// How many values there are is told with what they are, rather than with their number alone.
void CheckCount(const std::string& name, std::size_t given, const char* values, int least, int most) {
  if (given >= static_cast<std::size_t>(least) && given <= static_cast<std::size_t>(most)) return;
  throw UsageError(fmt::format(
      "send {}: {} value(s) given; accepted: {}, {}; see tendril send {} --help", name, given,
      least == most ? fmt::format("{}", least) : fmt::format("{} to {}", least, most), values, name));
}

void AddTarget(CLI::App& send, const std::shared_ptr<SendOptions>& o, const char* name,
               const char* description, const char* values, int least, int most,
               void (*fill)(const std::vector<double>&, Command&)) {
  CLI::App* sub = send.add_subcommand(name, description)->fallthrough();
  sub->add_option("values", o->values, values)
      ->expected(0, -1)
      ->option_text(values)
      ->check(NumberFrom(-kMostValue, kMostValue, "give metres, radians or newtons"));
  sub->callback([=] {
    CheckCount(name, o->values.size(), values, least, most);
    Command command;
    fill(o->values, command);
    Send(*o, command);
  });
}

void AddMode(CLI::App& send, const std::shared_ptr<SendOptions>& o, const char* name, const char* description,
             ModeRequest request) {
  send.add_subcommand(name, description)->fallthrough()->callback([o, request] {
    Command command;
    command.kind = CommandKind::kMode;
    command.mode = request;
    Send(*o, command);
  });
}

}  // namespace

void AddSendCommand(CLI::App& app) {
  auto o = std::make_shared<SendOptions>();
  CLI::App* send =
      app.add_subcommand("send", "Command a running daemon and wait for its answer")->fallthrough(false);
  AddLcmOptions(*send, o->lcm);
  send->add_option("--speed", o->speed_radps,
                   "bending speed towards the target [rad/s]; 0: the daemon's default")
      ->check(NumberFrom(0, kMostSpeed_radps, "leave it out for the daemon's own"));
  send->add_option("--valid-for", o->valid_for_s, "age at which the command is refused [s]")
      ->capture_default_str()
      ->check(NumberFrom(1e-3, 3600, "give seconds"));
  send->add_option(
          "--timeout", o->timeout_s,
          fmt::format("how long to wait for the daemon's answer [s] ({:g} unless given); arm: for the "
                      "daemon and its drives to be ready, too ({:g}); 0: not at all",
                      kTimeout_s, kArmTimeout_s))
      ->check(NumberFrom(0, 3600, "give seconds"));
  send->require_subcommand(1);
  AddTarget(*send, o, "tip", "Move the tip to a point in the base frame", "X Y Z in metres", 3, 3,
            [](const std::vector<double>& v, Command& c) {
              c.kind = CommandKind::kTip;
              c.tip_W_m = {v[0], v[1], v[2]};
              if (const std::string asked = AskMillimetres(c.tip_W_m); !asked.empty())
                throw UsageError(fmt::format("send tip: {:g} m is out of any robot's reach{}; give metres",
                                             c.tip_W_m.norm(), asked));
            });
  AddTarget(*send, o, "bending", "Bend each section: (u, v) = angle (cos, sin of the bending plane)",
            "U V of each section in radians", 2, 2 * kMaxSections,
            [](const std::vector<double>& v, Command& c) {
              c.kind = CommandKind::kBending;
              c.bending_rad = ToVector<BendingVector>(v);
            });
  AddTarget(*send, o, "tension", "Hold tendon tensions at the robot's base, one per tendon",
            "T1 T2 ... in newtons", 1, kMaxTendons, [](const std::vector<double>& v, Command& c) {
              c.kind = CommandKind::kTension;
              c.tension_N = ToVector<TendonVector>(v);
            });
  AddMode(*send, o, "arm", "Enable the drives and pretension; from hold: follow commands again",
          ModeRequest::kArm);
  AddMode(*send, o, "hold", "Stop and stay", ModeRequest::kHold);
  AddMode(*send, o, "disarm", "Ramp the tensions down and disable the drives", ModeRequest::kDisarm);
  AddMode(*send, o, "clear", "Acknowledge a fault", ModeRequest::kClear);
}

}  // namespace tendril::tools
