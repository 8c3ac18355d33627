// Refused commands as log lines; see the header.
#include "tendril/daemon/refusals.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string_view>
#include <vector>

#include "tendril/control/gate.h"
#include "tendril/core/tip_unit.h"
#include "tendril/io/client.h"

namespace tendril::daemon {
namespace {

constexpr TimeNs kAgainAfter_ns = kNsPerS;

template <class Vector>
std::string Values(const char* what, const Vector& values, const char* unit) {
  if (values.size() == 0) return fmt::format("{} without any value", what);
  return fmt::format("{} {:.4g} {}", what, fmt::join(values.begin(), values.end(), " "), unit);
}

std::string_view RequestText(ModeRequest request) {
  switch (request) {
    case ModeRequest::kArm:
      return "arm";
    case ModeRequest::kDisarm:
    case ModeRequest::kStop:
      return "disarm";
    case ModeRequest::kHold:
      return "hold";
    case ModeRequest::kClear:
      return "clear";
    case ModeRequest::kCommission:
      return "commission";
    case ModeRequest::kHome:
      return "home";
    case ModeRequest::kNotCommissioned:
    case ModeRequest::kDriveExchanged:
      return "arm or home";
    case ModeRequest::kNotAlone:
      return "arm, home or commission";
  }
  return "an unknown request";
}

}  // namespace

std::string CommandText(const Command& c) {
  switch (c.kind) {
    case CommandKind::kNone:
      return "nothing";
    case CommandKind::kTip:
      return Values("tip", c.tip_W_m, "m");
    case CommandKind::kBending:
      return Values("bend", c.bending_rad, "rad");
    case CommandKind::kTension:
      return Values("tension", c.tension_N, "N");
    case CommandKind::kMode:
      return std::string(RequestText(c.mode));
  }
  return "an unknown command";
}

std::string OutOfReachText(const Command& c, const Eigen::Vector3d& nearest_W_m, double length_m) {
  return fmt::format(
      "the requested tip is {:.4g} mm out of reach: the nearest point that the robot can reach is {:.4g} "
      "m; "
      "accepted: up to {:.3g} mm away (a tenth of the robot's length); request a nearer one{}",
      1e3 * (c.tip_W_m - nearest_W_m).norm(), fmt::join(nearest_W_m.begin(), nearest_W_m.end(), " "),
      1e3 * control::kOutOfReach * length_m, AskMillimetres(c.tip_W_m, length_m));
}

std::string OutOfRangeText(const Command& c, const RobotParameters& robot) {
  const LimitParameters& limits = robot.limits;
  if (c.speed_radps < 0 || c.speed_radps > kMostSpeed_radps) {
    return fmt::format("the speed is {:g} rad/s; accepted: 0 (the daemon's own) to {:g}; correct it",
                       c.speed_radps, kMostSpeed_radps);
  }
  if (c.valid_for_ns <= 0 || c.valid_for_ns > control::kLongestValid_ns) {
    return fmt::format("valid_for_s is {:g} or no number; accepted: above 0, up to {:g}; correct it",
                       ToSeconds(c.valid_for_ns), ToSeconds(control::kLongestValid_ns));
  }
  if (c.kind == CommandKind::kTip && c.tip_W_m.cwiseAbs().maxCoeff() > kMostTip_m) {
    return fmt::format("the requested tip is {:.4g} m from the base; accepted: up to {:g} m{}; give metres",
                       c.tip_W_m.norm(), kMostTip_m, AskMillimetres(c.tip_W_m, robot.body.length_m()));
  }
  if (c.kind == CommandKind::kBending) {
    for (Eigen::Index k = 0; k + 1 < c.bending_rad.size(); k += 2) {
      if (const double bend = c.bending_rad.segment<2>(k).norm(); bend > limits.max_bending_rad) {
        return fmt::format(
            "section {} would be bent by {:.4g} rad; accepted: up to {:g} (limits.max_bending_rad); bend it "
            "less",
            k / 2 + 1, bend, limits.max_bending_rad);
      }
    }
  }
  if (c.kind == CommandKind::kTension) {
    for (Eigen::Index j = 0; j < c.tension_N.size(); ++j) {
      if (c.tension_N[j] < 0 || c.tension_N[j] > limits.max_tension_base_N) {
        return fmt::format(
            "tendon {} would have {:.4g} N; accepted: 0 to {:g} (limits.max_tension_base_N); correct it",
            j + 1, c.tension_N[j], limits.max_tension_base_N);
      }
    }
  }
  if (c.kind != CommandKind::kTension && c.valid_for_ns > control::kLongestUnattended_ns) {
    return fmt::format(
        "a moving target would be valid for {:g} s; accepted: up to {:g}; send the next before that",
        ToSeconds(c.valid_for_ns), ToSeconds(control::kLongestUnattended_ns));
  }
  return {};
}

std::string WrongModeText(Mode mode) {
  std::vector<std::string_view> accepted;
  const auto ask = [&](std::string_view name, CommandKind kind, ModeRequest request = {}) {
    Command c;
    c.kind = kind;
    c.mode = request;
    if (control::CommandGate::AcceptedIn(mode, c)) accepted.push_back(name);
  };
  for (const ModeRequest request : {ModeRequest::kArm, ModeRequest::kHome, ModeRequest::kCommission,
                                    ModeRequest::kHold, ModeRequest::kClear, ModeRequest::kDisarm})
    ask(RequestText(request), CommandKind::kMode, request);
  ask("tip", CommandKind::kTip);
  ask("bending", CommandKind::kBending);
  ask("tension", CommandKind::kTension);
  return fmt::format("{}; accepted: {}", StatusText(Status::kCommandWrongMode), fmt::join(accepted, ", "));
}

std::string WrongSizeText(const Command& c, const RobotParameters& robot) {
  if (c.kind == CommandKind::kTension) {
    return fmt::format("{} tension(s) given; accepted: {}, one per tendon; give all", c.tension_N.size(),
                       robot.body.tendons());
  }
  if (c.kind == CommandKind::kBending) {
    const std::size_t required = 2 * robot.body.sections.size();
    if (c.bending_rad.size() != static_cast<Eigen::Index>(required))
      return fmt::format("{} bend value(s) given; accepted: {}, u and v of each section; give all",
                         c.bending_rad.size(), required);
    return fmt::format("{} rate(s) given; accepted: none, or {}, as many as bends; give all",
                       c.bending_rate_radps.size(), required);
  }
  return {};
}

std::string AnotherSenderText(std::uint32_t sender_in_control, Mode mode) {
  if (mode == Mode::kCommissioning) {
    return fmt::format("{} is commissioning the robot; wait until it has ended, or disarm",
                       io::SenderText(sender_in_control));
  }
  return fmt::format(
      "{} controls the robot, and targets of other senders are refused meanwhile; stop one of the two",
      io::SenderText(sender_in_control));
}

void Refusals::Add(Status cause, const Command& command, Mode mode, const std::string& why) {
  Cause& c = causes_[cause];
  ++c.count;
  c.command = command;
  c.mode = mode;
  c.why = why;
}

void Refusals::ReportDue(TimeNs now_ns, const Sink& sink) {
  for (auto& [cause, c] : causes_) {
    if (c.count == c.reported || now_ns < c.next_ns) continue;
    const std::string_view remedy = c.why.empty() ? StatusRemedy(cause) : std::string_view();
    const std::string sender = c.command.sender == 0 ? "" : " of " + io::SenderText(c.command.sender);
    sink(cause, fmt::format("{} (sequence {}{}) in mode {}: {}{}{}; {} refused for this, {} since start",
                            CommandText(c.command), c.command.sequence, sender, ModeText(c.mode),
                            c.why.empty() ? StatusText(cause) : c.why, remedy.empty() ? "" : "; ", remedy,
                            c.count - c.reported, c.count));
    c.reported = c.count;
    c.next_ns = now_ns + kAgainAfter_ns;
  }
}

}  // namespace tendril::daemon
