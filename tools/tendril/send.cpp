// tendril send: one command to a daemon over LCM, and what became of it. Knows nothing of the robot: the
// daemon judges.
#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <stdexcept>
#include <vector>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "tendril/core/cycle.h"
#include "tendril/core/status.h"
#include "tendril/io/client.h"
#include "tendril_lcm/state_t.hpp"

namespace tendril::tools {
namespace {

struct SendOptions {
  LcmOptions lcm;
  double speed_radps = 0;
  double valid_for_s = 1;
  double timeout_s = 2;
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
  for (const std::int16_t status : state.reported)
    text += fmt::format("; {} {}", status, StatusText(static_cast<Status>(status)));
  if (state.target_distance_m > 0) {
    text += fmt::format(" ({:.2f} mm away from the point asked for)", 1e3 * state.target_distance_m);
  }
  return text;
}

void Send(const SendOptions& o, Command command) {
  command.sequence = io::SequenceFromTime();
  command.valid_for_ns = static_cast<TimeNs>(o.valid_for_s * static_cast<double>(kNsPerS));
  command.speed_radps = o.speed_radps;

  io::Client client(o.lcm.url, o.lcm.prefix);
  bool heard = false, answered = false, settled = false;
  tendril_lcm::state_t answer{};
  client.OnState([&](const tendril_lcm::state_t& state) {
    heard = true;
    if (settled || state.command_sequence != command.sequence) return;
    answered = true;
    // Drives that a clear starts again take a moment, in which nothing is to be said yet.
    const bool clear = command.kind == CommandKind::kMode && command.mode == ModeRequest::kClear;
    settled = !clear || state.command_status != 0 || state.mode != tendril_lcm::state_t::MODE_DISCONNECTED;
    answer = state;
  });
  if (!client.Send(command, EpochUs())) {
    throw std::runtime_error("LCM could not send the command on " + o.lcm.url);
  }
  const MonotonicClock clock;
  const TimeNs end_ns = clock.Now() + static_cast<TimeNs>(o.timeout_s * static_cast<double>(kNsPerS));
  while (!settled && clock.Now() < end_ns) client.Handle(20);
  if (o.timeout_s == 0) return;
  if (!heard) {
    throw std::runtime_error(
        fmt::format("no daemon answers on {} ({}_STATE) within {:g} s; is tendrild running, with the same "
                    "--lcm and --prefix?",
                    o.lcm.url, o.lcm.prefix, o.timeout_s));
  }
  if (!answered) {
    throw std::runtime_error(
        fmt::format("the daemon is there but did not see the command within {:g} s; try again", o.timeout_s));
  }
  if (answer.command_status != 0) {
    std::string more;
    for (const std::int16_t number : answer.reported) {
      const auto status = static_cast<Status>(number);
      if (number != answer.command_status)
        more += fmt::format(": {} {}; {}", number, StatusText(status), StatusRemedy(status));
    }
    throw std::runtime_error(fmt::format("{} ({}, mode {}{})", answer.command_status_text,
                                         answer.command_status, answer.mode_text, more));
  }
  fmt::print("{}\n", Describe(answer));
}

template <class Vector>
Vector ToVector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

void AddTarget(CLI::App& send, const std::shared_ptr<SendOptions>& o, const char* name,
               const char* description, const char* values, int least, int most,
               void (*fill)(const std::vector<double>&, Command&)) {
  CLI::App* sub = send.add_subcommand(name, description)->fallthrough();
  sub->add_option("values", o->values, values)->required()->expected(least, most)->option_text(values);
  sub->callback([o, fill] {
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
      ->check(NumberFrom(0, 1e3, "leave it out for the daemon's own"));
  send->add_option("--valid-for", o->valid_for_s, "how old the command may get before it is refused [s]")
      ->capture_default_str()
      ->check(NumberFrom(1e-3, 3600, "give seconds"));
  send->add_option("--timeout", o->timeout_s, "how long to wait for the daemon's answer [s]; 0: not at all")
      ->capture_default_str()
      ->check(NumberFrom(0, 3600, "give seconds"));
  send->require_subcommand(1);
  AddTarget(*send, o, "tip", "Move the tip to a point in the base frame", "X Y Z [m]", 3, 3,
            [](const std::vector<double>& v, Command& c) {
              c.kind = CommandKind::kTip;
              c.tip_W_m = {v[0], v[1], v[2]};
            });
  AddTarget(*send, o, "bending", "Bend each section: (u, v) = angle (cos, sin of the bending plane)",
            "U V ... [rad]", 2, 2 * kMaxSections, [](const std::vector<double>& v, Command& c) {
              c.kind = CommandKind::kBending;
              c.bending_rad = ToVector<BendingVector>(v);
            });
  AddTarget(*send, o, "tension", "Hold tendon tensions at the robot's base, one a tendon", "T1 T2 ... [N]", 1,
            kMaxTendons, [](const std::vector<double>& v, Command& c) {
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
