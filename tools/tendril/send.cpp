// tendril send: one command to a daemon over LCM, and what became of it. Knows nothing of the robot: the
// daemon judges.
#include <fmt/format.h>

#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "tendril/core/cycle.h"
#include "tendril/core/tip_unit.h"
#include "tendril/io/send_command.h"

namespace tendril::tools {
namespace {

// A starting daemon listens for two seconds whether it is alone; its drives take some more.
constexpr double kTimeout_s = 2, kArmTimeout_s = 15;
// Largest value of a target: more is meant for no robot, in any unit.
constexpr double kMostValue = 1e6;

struct SendOptions {
  LcmOptions lcm;
  double speed_radps = 0;
  double valid_for_s = 1;
  double timeout_s = -1;  // not given
  std::vector<double> values;
};

void Send(const SendOptions& o, Command command) {
  command.valid_for_ns = static_cast<TimeNs>(o.valid_for_s * static_cast<double>(kNsPerS));
  command.speed_radps = o.speed_radps;
  const bool arm = command.kind == CommandKind::kMode && command.mode == ModeRequest::kArm;
  const io::CommandCall call{.url = o.lcm.url,
                             .channel_prefix = o.lcm.prefix,
                             .command = command,
                             .timeout_s = o.timeout_s >= 0 ? o.timeout_s
                                          : arm            ? kArmTimeout_s
                                                           : kTimeout_s};
  const std::string answer =
      io::SendCommand(call, [](const std::string& what) { fmt::print(stderr, "waiting for {}\n", what); });
  if (!answer.empty()) fmt::print("{}\n", answer);
}

template <class Vector>
Vector ToVector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

// A wrong number of values is reported with what the values mean.
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
      ->expected(1, -1)
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
  AddOperatorOptions(*send, o->lcm);
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
